"""Members that stall: their motion slides along a jump, which no step follows. The others are not affected."""

import numpy as np
import pytest

from barbalat import Simulation, load_case, simulate, simulate_ensemble
from barbalat.judge.judged import CLASSES
from barbalat.judge.settings import Judge
from barbalat.judge.verdict import Class
from independent import refusal
from relay import Relay

PAPER = load_case("paper")
SIMULATION = Simulation(4.0, tolerance=1e-6)


def together(*relays, judge=None):
    return simulate_ensemble([(PAPER.problem, Relay(*numbers)) for numbers in relays], SIMULATION, judge=judge)


@pytest.mark.parametrize("size", [0.5, 50.0])
def test_a_single_run_that_slides_is_refused(size) -> None:
    said = refusal(lambda: simulate(PAPER.problem, Relay(size), SIMULATION))
    assert "the solution slides along a discontinuity of the equations" in said
    assert said.endswith("or give simulation.dt")


def test_one_stalled_member_ends_alone() -> None:
    """The metrics of the stalled member are unknown, and it is marked as lost. The results of the other members do not depend on
    it."""
    sound = (0.0, 1.0), (0.0, 0.99)
    found = together(sound[0], (2.0, 1.0), sound[1], (50.0, 0.9), judge=Judge())
    others = together((3.0, 0.95), *sound, judge=Judge())
    assert found.stalled.tolist() == [False, True, False, True]
    assert others.stalled.tolist() == [True, False, False]
    assert np.isnan(found.metrics.diverged_at).all()
    for name, values in vars(found.metrics).items():
        if values is not None:
            assert np.isnan(values[[1, 3]]).all(), name
            assert np.array_equal(values[[0, 2]], getattr(others.metrics, name)[1:], equal_nan=True), name
    assert [CLASSES[kind] for kind in found.judged.kinds] == [Class.FOLLOWS, Class.LOST, Class.FOLLOWS, Class.LOST]
    assert "0 diverged, 2 stalled" in repr(found)
    assert "stalled" not in repr(together(*sound))


def test_the_first_member_may_stall() -> None:
    """The cost of all members is estimated from this run."""
    assert together((2.0, 1.0), (0.0, 1.0)).stalled.tolist() == [True, False]
