"""The comparison's runs against SciPy; which tunings count as beaten; that the draws are even and alike on both sides."""

import numpy as np

from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import figures
from barbalat.papers.jafari_2013.tracking import does_better
from barbalat.papers.jafari_2013.tracking.does_better import Side
from papers import by_hand


def side(*reached):
    return Side("a side", tuple("abc"[: len(reached)]), np.array(reached, dtype=float))


def test_who_is_beaten():
    """Worse in no objective and better in one; what is equal in all is not beaten, and a lost tuning is left to nobody."""
    one = side((1.0, 5.0), (2.0, 2.0), (np.inf, np.inf))
    every = (0, 1)
    assert list(one.unbeaten(side((2.0, 1.0)), every)) == [0]
    assert list(one.unbeaten(side((1.0, 5.0), (2.0, 2.0)), every)) == [0, 1]
    assert list(one.unbeaten(side((0.5, 9.0)), every)) == [0, 1]
    assert list(one.unbeaten(side((0.5, 9.0)), (0,))) == []


def test_the_draws_are_even_and_the_time_constants_of_both_sides_have_one_range():
    assert does_better.L1_KNOBS["kappa"] == does_better.ROBUST_KNOBS["tau"]
    for knobs in (does_better.L1_KNOBS, does_better.ROBUST_KNOBS):
        found = does_better.drawn(knobs, does_better.BUDGET)
        for values, (low, high) in zip(found.T, knobs.values(), strict=True):
            octants = np.floor(8 * np.log(values / low) / np.log(high / low))
            assert list(np.bincount(octants.astype(int), minlength=8)) == [does_better.BUDGET // 8] * 8  # Sobol's


def test_the_robust_mracs_numbers_are_scipys():
    """Nominal, and beside the constant disturbance; projection left out on both sides."""
    t = np.linspace(0, 20, 40_001)
    for d in (0.0, 20.0):
        e, _ = by_hand.robust_mrac(lambda time: 50 * np.sin(0.5 * time), t, tau=0.5, d=lambda _, d=d: d)
        given = does_better._disturbed(section_v.problem(), does_better.DISTURBANCES["d = 20"] if d else None)
        found = figures([(given, section_v.robust_mrac("r", projection=False))], 20.0, 1e-4)
        np.testing.assert_allclose(found.max_abs_e[0], np.abs(e).max(axis=0), rtol=1e-4)


def test_the_delay_that_is_borne_is_that_of_the_frozen_loop_for_short_time_constants():
    """1/(tau s) behind the delay is nearly all of the loop for a small tau, lost at pi tau/2, between two delays of the grid."""
    tau = 0.03
    reached = does_better._reached([section_v.robust_mrac("r", tau)], 5e-4)
    below = does_better.DELAYS[np.pi * tau / 2 > does_better.DELAYS][-1]
    assert -reached[0, -1] == below
    np.testing.assert_allclose(
        reached[0, 0], figures([(section_v.problem(), section_v.robust_mrac("r", tau))], 60.0, 1e-4).max_abs_e.max(), rtol=0.02
    )
