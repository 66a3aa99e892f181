"""The row that reads stored flights: what it makes of documents whose answer is known, and of the stored ones."""

from itertools import combinations, product
from pathlib import Path

import pytest

from barbalat.claims import flown
from barbalat.claims.stored_flights import ADAPTIVE_SCHEMES, ERROR, LINEAR_SCHEMES, LOSS, Flights, stored

PAGE = Path(__file__).parents[2] / "docs" / "guides" / "aircraft.md"
LEAST_LOST = ("MRAC", "L1 piecewise, as flown", "Robust MRAC", "ADRC")
BETTER = {"ADRC": ("none", "elevator-50", "aft-cg"), "LQR with PI": ("elevator-50", "aft-cg"), "MRAC": ("hard-over",)}
"""Who has less error than every scheme of the other side, and through what."""


def share(count, judged):
    return {"count": count, "judged": judged}


def document(best, wins=20, *, also=""):
    """Two failures that are survived, and one that is not; through ``gusts`` ``best`` beats all others on so many draws.

    also  the same through ``none``
    """
    names = ("LQR with PI", "L1", "MRAC", "Robust MRAC", "L1 piecewise, as flown")
    ahead = {"gusts": best, "none": also}

    def against(name, other, failure):
        if failure == "reversed":
            return None
        return share({name: wins, other: 20 - wins}.get(ahead[failure], 10), 20)

    def one(name, failure):
        lost = 20 if failure == "reversed" else 0
        pairs = {other: against(name, other, failure) for other in names if other != name}
        error = None if lost else 0.1 if name == ahead[failure] else 0.5
        return {
            "lost": share(lost, 20),
            "rms_e": {"median": error},
            "less_error_than": pairs,
            "kept_where_lost": pairs,
        }

    return {
        "flight": "f16-pitch", "members": 20, "plan": {"seed": 1}, "equations": "0" * 64,
        "versions": {"jsbsim": "1", "barbalat": "1"}, "units": {"rms_e": "deg/s"},
        "lost": {name: {"count": 20, "flights": 60} for name in names},
        "failures": {failure: {name: one(name, failure) for name in names} for failure in ("none", "gusts", "reversed")},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("best", "also", "found"),
    [
        ("L1", "", "confirmed with conditions"),
        ("L1", "MRAC", "confirmed"),
        ("LQR with PI", "", "not confirmed"),
        ("", "", "not confirmed"),
        ("L1", "LQR with PI", "not confirmed"),  # as often the one as the other
    ],
)
def test_an_adaptive_scheme_must_beat_every_linear_one_through_more_than_the_reverse(best, also, found, monkeypatch):
    monkeypatch.setattr(Flights, "stored", lambda name: Flights(document(best, also=also)))
    claim = flown.claim()
    losses, errors, *_ = claim.readings
    assert (losses.verdict, errors.verdict) == (found, found)
    if best == "LQR with PI":
        assert "than every adaptive scheme: LQR with PI through gusts (0.1 for 0.5 deg/s)" in errors.measured


def test_the_number_is_of_all_stored_flights_together(monkeypatch):
    """Of 60 flights each, with two failures that are survived: in one document MRAC is ahead through ``gusts``, beyond chance."""
    better = document("L1")
    better["lost"]["MRAC"]["count"] = 0
    kept = {"f16-pitch": document("MRAC"), "f16-roll": better}
    monkeypatch.setattr(flown, "stored", lambda: tuple(kept))
    monkeypatch.setattr(Flights, "stored", lambda name: Flights(kept[name]))
    claim = flown.claim()
    assert claim.number == "fewest flights lost of 120: adaptive 20, linear 40; apart beyond chance in 1 of 4 failures"
    assert "of 60: adaptive 20 (MRAC), linear 20 (LQR with PI)" in claim.measured and "adaptive 0 (MRAC)" in claim.measured


def test_all_comparisons_share_one_confidence():
    """17 of 20 is beyond chance by itself, P = 0.0026, and not as the best of the 40 that this document has."""
    flights = Flights(document("L1", wins=17))
    assert len(flights.shares) == 2 * 2 * 10
    assert flights.shares["gusts", "LQR with PI", "L1", "less_error_than"].chance == pytest.approx(2 * 1351 / 2**20)
    assert not any(flights.signs.values())


def test_a_failure_that_nobody_survives_says_nothing_of_who_is_better():
    assert Flights(document("L1")).failures == ("none", "gusts")


@pytest.mark.parametrize("name", stored())
def test_the_stored_flights_are_all_there(name):
    kept = Flights.stored(name).document
    assert kept["flight"] == name
    assert set(kept["lost"]) <= {*LINEAR_SCHEMES, *ADAPTIVE_SCHEMES}
    for failure, found in kept["failures"].items():
        assert set(found) == set(kept["lost"]), failure
        for one in found.values():
            assert one["lost"]["judged"] == kept["members"]
            assert (one["rms_e"]["median"] is None) == (2 * one["lost"]["count"] > kept["members"])
    total = {one: sum(found[one]["lost"]["count"] for found in kept["failures"].values()) for one in kept["lost"]}
    assert total == {one: found["count"] for one, found in kept["lost"].items()}
    assert f"`barbalat fly {name} --dispersions {kept['members']} --json`" in flown.claim().how


@pytest.fixture(scope="module")
def flights():
    return Flights.stored("f16-pitch")


def test_who_wins_in_the_guide_wins_in_the_stored_flights(flights):
    """What docs/guides/aircraft.md says of 200 draws."""
    assert tuple(flights.document["lost"])[:4] == LEAST_LOST
    for one, other in combinations(LEAST_LOST, 2):
        assert not any(flights.compared(one, other, failure, LOSS) for failure in flights.failures)
    for one, other in product(LEAST_LOST, ("LQR with PI", "H-infinity", "L1")):
        assert flights.compared(one, other, "delay-100", LOSS) == 1
    better = {
        (one, failure, by)
        for names, others in ((flights.linear, flights.adaptive), (flights.adaptive, flights.linear))
        for one in names
        for by in (ERROR, LOSS)
        for failure in flights.over_all(one, others, by)
    }
    assert better == {(name, failure, ERROR) for name, failures in BETTER.items() for failure in failures}
    assert "hard-over" in flights.over_all("MRAC", [*flights.linear, *flights.adaptive], ERROR)
    assert flights.compared("ADRC", "L1 piecewise, as flown", "gusts") == 0
    signs = {failure: flights.compared("L1", "MRAC", failure) for failure in flights.failures}
    assert [failure for failure, sign in signs.items() if sign == 1] == ["aft-cg"]
    assert list(signs.values()).count(-1) == 4


def test_the_numbers_of_the_guide_are_those_of_the_stored_flights(flights):
    said = " ".join(PAGE.read_text(encoding="utf-8").split())
    total = [flights.document["lost"][name]["count"] for name in LEAST_LOST]
    few, many = (
        sorted(flights.lost(name, "delay-100") for name in names) for names in (LEAST_LOST, ("LQR with PI", "H-infinity", "L1"))
    )
    ahead = flights.document["failures"]["gusts"]["ADRC"][ERROR]["L1 piecewise, as flown"]
    hard = {name: (flights.lost(name, "hard-over"), flights.error(name, "hard-over")) for name in flights.document["lost"]}
    singly, together = (
        sum(one.chance <= 0.05 for one in flights.shares.values()),
        sum(map(abs, flights.signs.values())),
    )
    for expected in (
        f"What {flights.members} draws came to",
        f"lose least, {min(total)} to {max(total)} of 1400, {flights.lost('ADRC', 'reversed')} of them to a reversed elevator",
        f"costs these four {few[0]} to {few[-1]} flights and the PI, `hinf` and `l1` {many[0]} to {many[-1]}",
        f"fewest with the delay, {flights.lost('LQR', 'delay-100')}, and {flights.lost('LQR', 'aft-cg')} with the centre",
        f"ahead of `l1-piecewise-flown` on {ahead['count']} draws of {ahead['judged']}",
        f"its median is {hard['MRAC'][1]:.2f} deg/s where `adrc` has {hard['ADRC'][1]:.2f}",
        f"it loses {hard['MRAC'][0]} flights where the PI loses {hard['LQR with PI'][0]}",
        f"Of {len(flights.shares)} comparisons that some draw decides, {singly} would be beyond chance singly, {together} are so",
        f"time ended it at {flights.document['resumed']}",
        f"flew the other {flights.members - flights.document['resumed']}",
    ):
        assert expected in said


def test_what_the_guide_says_of_rolling_flights_is_what_is_stored():
    flights = Flights.stored("f16-roll")
    ahead = {
        (one, by): set(flights.over_all(one, others, by))
        for names, others in ((flights.linear, flights.adaptive), (flights.adaptive, flights.linear))
        for one in names
        for by in (ERROR, LOSS)
    }
    assert {key: found for key, found in ahead.items() if found} == {
        ("LQR", LOSS): {"reversed"},
        ("LQR", ERROR): {"delay-100", "reversed"},
        ("LQR with PI", ERROR): {"aileron-50", "side-cg", "gusts"},
    }
    assert all(flights.compared("L1", "MRAC", failure) == -1 for failure in flights.failures if failure != "reversed")
    lost = {one: found["count"] for one, found in flights.document["lost"].items()}
    others = [count for one, count in lost.items() if one != "LQR"]
    said = " ".join(PAGE.read_text(encoding="utf-8").split())
    for expected in (
        f"{min(others)} to {max(others)} of 1400",
        f"loses {flights.lost('LQR', 'side-cg')} with the centre of gravity",
        f"keeps {flights.members - flights.lost('LQR', 'reversed')} of {flights.members} with reversed ailerons",
    ):
        assert expected in said
