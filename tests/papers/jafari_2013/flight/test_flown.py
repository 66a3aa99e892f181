"""The row that reads stored flights: its result for documents with a known answer and for the stored ones."""

from itertools import combinations, product
from pathlib import Path

import pytest

from barbalat.papers.jafari_2013.flight import flown
from barbalat.papers.jafari_2013.flight.flown import ADAPTIVE_SCHEMES, ERROR, LINEAR_SCHEMES, LOSS, Flights, stored

PAGE = Path(__file__).parents[4] / "docs" / "laboratory" / "f16.md"
LEAST_LOST = ("MRAC", "L1 piecewise, as flown", "Robust MRAC", "ADRC")
BETTER = {
    "ADRC": ("none", "elevator-50", "aft-cg", "gusts"),
    "L1 piecewise, as flown": ("none", "aft-cg", "gusts"),
    "L1 piecewise": ("gusts",),
    "LQR with PI": ("elevator-50", "aft-cg"),
    "H-infinity": ("aft-cg",),
    "MRAC": ("hard-over",),
}
"""The schemes with a smaller error than every scheme of the other side, and the failures."""


def share(count, judged):
    return {"count": count, "judged": judged}


def document(best, wins=20, *, also=""):
    """A document with two failures that are survived and one that is not. Through ``gusts`` ``best`` beats all others in the
    given number of draws.

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
    ("best", "also", "follows"),
    [
        ("L1", "", True),
        ("L1", "MRAC", True),
        ("LQR with PI", "", False),
        ("L1 piecewise, as flown", "", False),  # a linear controller
        ("", "", False),
        ("L1", "LQR with PI", False),  # each equally often
    ],
)
def test_an_adaptive_scheme_must_beat_every_linear_one_through_more_than_the_reverse(best, also, follows):
    claim = flown.in_flight([Flights(document(best, also=also))])
    losses, errors, *_ = claim.readings
    assert (losses.holds, errors.holds) == (False, follows)  # the same number is lost on both sides
    assert claim.finding == ("mixed" if follows else "fails")
    if best == "LQR with PI":
        assert "a linear design is ahead of every adaptive scheme for 1 (f16-pitch: gusts)" in errors.measured


def test_the_losses_are_of_all_stored_flights_together_without_reversed_surfaces():
    """40 flights count for each. In one document MRAC loses five fewer through ``gusts``, which is beyond chance by the pairs."""
    better = document("MRAC")
    for name, found in better["failures"]["gusts"].items():
        found["lost"]["count"] = 0 if name == "MRAC" else 5
    claim = flown.in_flight([Flights(document("")), Flights(better)])
    assert claim.shows.startswith("Of 80 flights without reversed surfaces, adaptive schemes lose 0, linear designs 5.")
    assert (
        claim.readings[0].holds
        and "1 of 4 failures show this order beyond chance and 0 show the opposite order" in claim.readings[0].measured
    )


def test_whether_l1_follows_better_than_mrac_depends_on_the_vehicle():
    """The wins are counted again from the stored documents, with each comparison's own share."""
    claim = flown.claims()[1]
    assert claim.id == "l1-mrac-in-flight" and claim.finding == "mixed" and claim.sentence.source.side == "ours"
    for (names, holds), reading in zip(((["quadrotor"], True), (["f16-pitch", "f16-roll"], False)), claim.readings, strict=True):
        every = [Flights.stored(name) for name in names]
        signs = [one.compared("L1", "MRAC", failure) for one in every for failure in one.failures]
        assert reading.literal and reading.holds is holds and (signs.count(1) > signs.count(-1)) is holds
        more, less = signs.count(1), signs.count(-1)
        assert (f"for {more} failures and larger for {less} on" if holds else f"are {more} and {less}.") in claim.shows


def test_all_comparisons_share_one_confidence():
    """17 of 20 is beyond chance by itself, with P = 0.0026, but not as the best of the 40 comparisons in this document."""
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
    assert f"`barbalat fly {name} --dispersions {kept['members']} --json`" in flown.claims()[0].how


@pytest.fixture(scope="module")
def flights():
    return Flights.stored("f16-pitch")


def test_who_wins_in_the_guide_wins_in_the_stored_flights(flights):
    """The winners in docs/laboratory/f16.md for 200 draws."""
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
        f"Results of {flights.members} draws",
        f"lose the fewest, {min(total)} to {max(total)} of 1400. Of these, {flights.lost('ADRC', 'reversed')} are lost to a "
        "reversed elevator",
        f"these four lose {few[0]} to {few[-1]} more flights, and the PI, `hinf` and `l1` lose {many[0]} to {many[-1]} more",
        f"fewest flights with the delay, {flights.lost('LQR', 'delay-100')}, but {flights.lost('LQR', 'aft-cg')} with the centre",
        f"ahead of `l1-piecewise-flown` on {ahead['count']} draws of {ahead['judged']}",
        f"its median is {hard['MRAC'][1]:.2f} deg/s (`adrc`: {hard['ADRC'][1]:.2f})",
        f"it loses {hard['MRAC'][0]} flights (PI: {hard['LQR with PI'][0]})",
        f"In {len(flights.shares)} comparisons the two schemes differ on at least one draw; {singly} of these would be "
        f"significant individually, and {together} are significant jointly",
        f"first ended at {flights.document['resumed']} for lack of time",
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
        ("LQR", ERROR): {"delay-100", "hard-over"},
        ("LQR with PI", ERROR): {"aileron-50", "side-cg", "gusts", "hard-over"},
    }
    assert all(flights.compared("L1", "MRAC", failure) == -1 for failure in flights.failures)
    lost = {one: found["count"] for one, found in flights.document["lost"].items()}
    others = [count for one, count in lost.items() if one != "LQR"]
    said = " ".join(PAGE.read_text(encoding="utf-8").split())
    for expected in (
        f"{min(others)} to {max(others)} of 1400",
        f"loses {flights.lost('LQR', 'side-cg')} with the centre of gravity",
        f"keeps {flights.members - flights.lost('LQR', 'reversed')} of {flights.members} with reversed ailerons",
    ):
        assert expected in said


BESIDE = ("H-infinity", "Robust MRAC", "ADRC", "L1 piecewise", "L1 piecewise, as flown", "L1")
"""The schemes that compensate disturbances at the input, with the fewest losses first."""


def test_what_the_guide_says_of_quadrotors_is_what_is_stored():
    flights = Flights.stored("quadrotor")
    sides = ((flights.linear, flights.adaptive), (flights.adaptive, flights.linear))
    ahead = {
        (one, by, failure)
        for names, others in sides
        for one in names
        for by in (ERROR, LOSS)
        for failure in flights.over_all(one, others, by)
    }
    wins = ("slung-mass", "half-propeller", "wind", "no-reset")
    assert ahead == {("Robust MRAC", ERROR, failure) for failure in wins}
    everybody = [*flights.linear, *flights.adaptive]
    assert set(wins[:3]) <= set(flights.over_all("Robust MRAC", everybody, ERROR))
    assert all(flights.compared("Robust MRAC", "H-infinity", one) == (one in wins) for one in flights.failures)
    for one, other in combinations(BESIDE, 2):
        assert not any(flights.compared(one, other, failure, LOSS) for failure in flights.failures)
    for one, other, apart in (
        ("H-infinity", "ADRC", ()),
        ("ADRC", "MRAC", ()),
        ("ADRC", "L1 piecewise, as flown", ("no-reset",)),
        ("ADRC", "L1", ("no-reset",)),
        ("L1", "MRAC", ()),
        ("Robust MRAC", "L1 piecewise, as flown", ()),
    ):
        assert all(flights.compared(one, other, failure) == (failure not in apart) for failure in flights.failures), (one, other)
    beside = {failure: flights.compared("ADRC", "L1 piecewise", failure) for failure in flights.failures}
    assert beside == dict.fromkeys(flights.failures, 1) | {"no-reset": -1}


def test_the_numbers_of_the_quadrotors_guide_are_those_that_are_stored():
    flights = Flights.stored("quadrotor")
    found = flights.document["failures"]
    total = {name: one["count"] for name, one in flights.document["lost"].items()}
    least = found["half-propeller"]["H-infinity"]["lost"]
    low, high = (100 * end for end in least["interval"])

    def beside(failure):
        share = found[failure]["Robust MRAC"][ERROR]["H-infinity"]
        return share["count"], share["judged"], "{:.0f} to {:.0f} %".format(*(100 * end for end in share["interval"]))

    pull = [beside(one) for one in ("slung-mass", "half-propeller", "wind", "no-reset")]
    medians = [
        ", ".join(f"{flights.error(name, one):.3g}" for one in ("slung-mass", "half-propeller", "wind"))
        + f" and {flights.error(name, 'no-reset'):.3g}"
        for name in ("Robust MRAC", "H-infinity")
    ]
    singly = sum(one.chance <= 0.05 for one in flights.shares.values())
    travel = [found["none"][name]["travel"]["median"] for name in ("L1 piecewise, as flown", "Robust MRAC")]
    assert list(total)[:2] == ["H-infinity", "Robust MRAC"]
    assert total["H-infinity"] == least["count"] == flights.lost("Robust MRAC", "half-propeller")
    assert total["Robust MRAC"] - least["count"] == flights.lost("Robust MRAC", "delay-20")
    said = " ".join((PAGE.parent / "quadrotor.md").read_text(encoding="utf-8").split())
    for expected in (
        f"Results of {flights.members} draws",
        f"loses the fewest: {least['count']} of {7 * flights.members} flights, all of them among the {flights.members} with half "
        f"a propeller ({100 * least['share']:.0f} % of these; 95 % interval {low:.0f} to {high:.0f} %)",
        f"loses as many there, and {flights.lost('Robust MRAC', 'delay-20')} with more delay",
        f"lose {total['ADRC']} to {total['L1']}.",
        f"MRAC loses {total['MRAC']}",
        f"{flights.lost('Geometric', 'half-propeller')} of {flights.members} with half a propeller and "
        f"{flights.lost('Geometric', 'slung-mass')} with the slung mass. With an integral it loses "
        f"{flights.lost('Geometric, integral', 'half-propeller')}, and {flights.lost('Geometric, integral', 'no-reset')} more",
        f"than `hinf` with the slung mass on {pull[0][0]} draws of {pull[0][1]} (95 % interval {pull[0][2]})",
        f"{pull[1][0]} of the {pull[1][1]} draws that at least one of the two survives ({pull[1][2]})",
        f"in the wind on {pull[2][0]} of {pull[2][1]} ({pull[2][2]})",
        f"than `hinf` on {pull[3][0]} draws; {pull[3][2]}",
        f"medians are {medians[0]} m; those of `hinf` are {medians[1]} m",
        f"{travel[0]:.3g} against {travel[1]:.2g} N/s",
        f"In {len(flights.shares)} comparisons the two schemes differ on at least one draw; {singly} of these would be "
        f"significant individually, and {sum(map(abs, flights.signs.values()))} are significant jointly",
    ):
        assert expected in said


def test_over_all_campaigns_linear_schemes_are_ahead_through_more_failures():
    """The numbers are the ones in docs/laboratory/f16.md, five and nine."""
    every = [Flights.stored(name) for name in stored()]
    assert [one.name for one in every] == ["f16-pitch", "f16-roll", "quadrotor"]

    def won(flights, ours, theirs):
        return len({failure for one in ours for failure in flights.over_all(one, theirs, ERROR)})

    ahead = sum(won(one, one.adaptive, one.linear) for one in every)
    behind = sum(won(one, one.linear, one.adaptive) for one in every)
    assert (ahead, behind) == (5, 9)
    assert flown.claims()[0].finding == "fails"
