"""The row that reads stored flights: what it makes of a document whose answer is known, and of the stored one."""

import json
from importlib import resources

import pytest

from barbalat.claims import flown
from barbalat.claims.flown import ADAPTIVE, LINEAR, Flights


def share(count, judged, low, high):
    return {"count": count, "share": count / judged, "interval": [low, high], "confidence": 0.95, "judged": judged}


def document(best):
    """Two failures that are survived, and one that is not; through ``gusts`` the scheme ``best`` beats all others."""
    names = ("LQR with PI", "L1", "MRAC", "Robust MRAC", "L1 piecewise, as flown")
    sure, unsure = share(20, 20, 0.83, 1.0), share(10, 20, 0.27, 0.73)

    def one(name, failure):
        wins = name == best and failure == "gusts"
        lost = 20 if failure == "reversed" else 0
        pairs = {other: (None if lost else sure if wins else unsure) for other in names if other != name}
        error = None if lost else 0.1 if wins else 0.5
        return {
            "lost": share(lost, 20, 0.0, 1.0),
            "rms_e": {"median": error},
            "less_error_than": pairs,
            "kept_where_lost": pairs,
        }

    return {
        "flight": "f16-pitch", "members": 20, "plan": {"seed": 1}, "equations": "0" * 64,
        "versions": {"jsbsim": "1", "barbalat": "1"},
        "lost": {name: {"count": 20, "flights": 60} for name in names},
        "failures": {failure: {name: one(name, failure) for name in names} for failure in ("none", "gusts", "reversed")},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("best", "found"), [("L1", "confirmed with conditions"), ("LQR with PI", "not confirmed"), ("", "not confirmed")]
)
def test_an_adaptive_scheme_must_beat_every_linear_one_beyond_chance(best, found, monkeypatch):
    monkeypatch.setattr(flown.json, "loads", lambda text: document(best))
    claim = flown.claim()
    losses, errors, *_ = claim.readings
    assert (losses.verdict, errors.verdict) == (found, found)
    if best == "LQR with PI":
        assert "than every adaptive scheme: LQR with PI through gusts" in errors.measured


def test_a_failure_that_nobody_survives_says_nothing_of_who_is_better():
    assert Flights(document("L1")).failures == ("none", "gusts")


def test_the_stored_flights_are_all_there():
    stored = json.loads(resources.files("barbalat.claims").joinpath("flown.json").read_text(encoding="utf-8"))
    assert set(stored["lost"]) == {*LINEAR, *ADAPTIVE}
    for failure, found in stored["failures"].items():
        assert set(found) == {*LINEAR, *ADAPTIVE}, failure
        for one in found.values():
            assert one["lost"]["judged"] == stored["members"]
            assert (one["rms_e"]["median"] is None) == (2 * one["lost"]["count"] > stored["members"])
    total = {name: sum(found[name]["lost"]["count"] for found in stored["failures"].values()) for name in stored["lost"]}
    assert total == {name: one["count"] for name, one in stored["lost"].items()}
    claim = flown.claim()
    assert "not measured by this command" in claim.how
