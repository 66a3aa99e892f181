"""The row that reads stored flights: what it makes of a document whose answer is known, and of the stored one."""

import json
from importlib import resources
from itertools import combinations

import pytest

from barbalat.claims import flown
from barbalat.claims.flown import ADAPTIVE, ERROR, LINEAR, LOSS, Flights


GUIDE = {"ADRC": ("none", "elevator-50", "aft-cg"), "LQR with PI": ("elevator-50", "aft-cg")}
"""Linear designs that follow better than every adaptive scheme, and through what."""


def share(count, judged):
    return {"count": count, "judged": judged}


def document(best, wins=20):
    """Two failures that are survived, and one that is not; through ``gusts`` the scheme ``best`` beats all others on so many draws."""
    names = ("LQR with PI", "L1", "MRAC", "Robust MRAC", "L1 piecewise, as flown")

    def against(name, other, failure):
        if failure == "reversed":
            return None
        better = {name: wins, other: 20 - wins}.get(best, 10) if failure == "gusts" else 10
        return share(better, 20)

    def one(name, failure):
        lost = 20 if failure == "reversed" else 0
        pairs = {other: against(name, other, failure) for other in names if other != name}
        error = None if lost else 0.1 if name == best and failure == "gusts" else 0.5
        return {
            "lost": share(lost, 20),
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


def test_all_comparisons_share_one_confidence():
    """17 of 20 is beyond chance by itself, P = 0.0026, and not as the best of the 40 that this document has."""
    flights = Flights(document("L1", wins=17))
    assert len(flights.shares) == 2 * 2 * 10
    assert flights.shares["gusts", "LQR with PI", "L1", "less_error_than"].chance == pytest.approx(2 * 1351 / 2**20)
    assert not any(flights.signs.values())


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
    assert "not measured by this command" in flown.claim().how


def test_what_the_guide_says_came_out_is_what_the_stored_flights_say():
    """The sentences on 200 draws of docs/guides/aircraft.md, whose table is made from the same document."""
    flights = Flights(json.loads(resources.files("barbalat.claims").joinpath("flown.json").read_text(encoding="utf-8")))
    lead = ("MRAC", "L1 piecewise, as flown", "Robust MRAC", "ADRC")
    assert tuple(flights.document["lost"])[:4] == lead
    for one, other in combinations(lead, 2):
        assert not any(flights.compared(one, other, failure, LOSS) for failure in flights.failures)
    better = {
        (one, failure)
        for names, others in ((LINEAR, ADAPTIVE), (ADAPTIVE, LINEAR))
        for one in names
        for by in (ERROR, LOSS)
        for failure in flights.over_all(one, others, by)
    }
    adrc, pi = ({(name, failure) for failure in failures} for name, failures in GUIDE.items())
    assert better == adrc | pi | {("MRAC", "hard-over")}
    apart = [one for one in flights.shares.values() if one.chance <= 0.05]
    assert (len(flights.shares), len(apart), sum(map(abs, flights.signs.values()))) == (317, 253, 239)
