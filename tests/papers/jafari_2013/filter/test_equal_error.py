"""MRAC and L1-AC at equal error: the matches for invented numbers are derived by hand, and both sides are drawn by one rule."""

import numpy as np
import pytest

from barbalat.controllers import Mrac
from barbalat.papers.jafari_2013.filter import equal_error
from barbalat.papers.jafari_2013.filter.equal_error import Fronts, fronts, listing, reading
from barbalat.papers.jafari_2013.section_v import variant
from barbalat.papers.jafari_2013.tunings import Side
from barbalat.signals import Constant
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import delay_margins_ensemble


def side(name: str, *reached: tuple[float, float, float]) -> Side:
    """A side, with each tuning's error and its delays to the start of oscillation and to loss."""
    return Side(name, tuple(f"{name} {k}" for k in range(len(reached))), np.array(reached) * [1, -1, -1])


MRAC = side("MRAC", (1.0, 0.01, 0.02), (2.0, 0.05, 0.05))
L1 = side("L1-AC", (1.5, 0.01, 0.01), (1.5, 0.04, 0.01))
"""The second tuning tolerates four times the delay of MRAC's only tuning until it oscillates, without a larger error."""


def test_a_tuning_is_matched_by_one_with_no_larger_error_and_no_shorter_delay():
    found = Fronts("r", MRAC, L1)
    assert list(found.advantages("onset")) == pytest.approx([1.0, 4.0])
    assert list(found.advantages("loss")) == pytest.approx([0.5, 0.5])
    assert list(found.drawbacks("onset")) == pytest.approx([np.inf, 1.25])  # no tuning of L1-AC has the error of the first one
    by_onset, by_loss = (reading([found], criterion) for criterion in ("onset", "loss"))
    assert not by_onset.holds and by_loss.holds and not by_onset.decides
    assert "0 of 1 L1-ACs with (6) and 1 of 1 with two slopes are not matched by MRAC; 2 of 2 MRACs" in by_onset.measured
    assert [row[-1] for row in listing([found]).rows] == ["1", "4", "0.5", "0.5"]


def test_both_sides_have_one_range_of_gains_and_as_many_tunings():
    assert equal_error.MRAC_KNOBS["Gamma"] == equal_error.L1_KNOBS["Gamma"]
    simulation, signal = Simulation(t_end=2.0, dt=2e-3), Constant(1.0)
    found = fronts("r = 1", signal, simulation, 4)
    assert len(found.mrac.tunings) == len(found.l1.tunings) == 4
    assert sum("(6)" in one for one in found.l1.tunings) == 2
    gamma = float(found.mrac.tunings[0].removeprefix("Gamma "))
    (alone,) = delay_margins_ensemble(
        [(variant(reference=signal), Mrac(gamma=gamma))], simulation, resolution=0.05
    ).onset.tolerates
    assert -found.mrac.reached[0, 1] == pytest.approx(alone, rel=0.15)  # gamma was printed with three digits
