"""The comparison's runs compared with SciPy's, the tunings that are regarded as beaten, and draws that are evenly distributed and
identical on both sides."""

import numpy as np

from barbalat.certificates.linear_loops.frozen import FrozenLoops, tolerated
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import figures
from barbalat.papers.jafari_2013.tracking import does_better
from barbalat.papers.jafari_2013.tunings import Side
from barbalat.problem.modelling_error import DelayError
from papers import by_hand


def side(*reached):
    return Side("a side", tuple("abc"[: len(reached)]), np.array(reached, dtype=float))


def test_who_is_beaten():
    """A tuning is beaten if some other tuning is worse in no objective and better in at least one. Equal tunings are not beaten,
    and lost ones are discarded."""
    one = side((1.0, 5.0), (2.0, 2.0), (np.inf, np.inf))
    every = (0, 1)
    assert list(one.unbeaten(side((2.0, 1.0)), every)) == [0]
    assert list(one.unbeaten(side((1.0, 5.0), (2.0, 2.0)), every)) == [0, 1]
    assert list(one.unbeaten(side((0.5, 9.0)), every)) == [0, 1]
    assert list(one.unbeaten(side((0.5, 9.0)), (0,))) == []


def test_the_first_half_of_a_side_is_compared_with_the_first_half_of_the_other():
    """Otherwise 32 tunings with the paper's filter would be compared with 64 of the robust MRAC."""
    one, other = side((1.0, 5.0), (2.0, 2.0)), side((9.0, 9.0), (0.5, 0.5))
    assert list(one.unbeaten(other, (0, 1))) == []
    assert list(one.first(1).unbeaten(other.first(1), (0, 1))) == [0]


def test_an_advantage_is_a_tuning_that_is_not_beaten():
    """A combination of objectives can be such an advantage: the last tuning of L1-AC is best in no objective, but no other tuning
    beats it."""
    none = np.ones((4, 5))
    robust = Side("robust MRAC", ("a",) * 4, none * [[1.0], [2.0], [3.0], [4.0]])
    beaten = Side("L1-AC", ("b",) * 4, none * 9.0)
    claim = does_better.no_advantage(beaten, robust)
    assert claim.finding == "holds" and claim.readings[-1].holds
    trade = np.array([[1.0, 9, 9, 9, 9], [9.0, 1, 9, 9, 9], [9, 9, 9, 9, 9], [9, 9, 9, 9, 9]])
    one = Side("L1-AC", ("b",) * 4, np.vstack([none[:3] * 99, [5.0, 5, 5, 5, 5]]))
    claim = does_better.no_advantage(one, Side("robust MRAC", ("a",) * 4, trade))
    assert claim.finding == "holds if" and claim.condition == "L1-AC has the paper's filter (6)"  # the last has two slopes
    assert claim.readings[0].measured.startswith("1 of 4") and "ahead in 3 objectives" in claim.readings[3].measured


def test_one_robust_mrac_has_to_beat_every_tuned_l1_ac():
    """The robust MRAC's lead over Section V's L1-AC does not matter, because that L1-AC is not tuned and the row counts its
    competitors on both sides."""
    own = np.array([8.0, 8, 8, 8, -0.1])
    robust = Side("robust MRAC", ("a", "b"), np.array([[4.0, 4, 4, 4, -0.4], [1.0, 1, 1, 9, -0.9]]))
    np.testing.assert_allclose(does_better.factors(robust, own), [[2, 2, 2, 2, 4], [8, 8, 8, 8 / 9, 9]])
    l1 = Side("L1-AC", ("c", "d"), np.array([[4.0, 9, 9, 9, -0.1], [2.0, 2, 2, 2, -0.3]]))  # c is beaten by a, d by no other
    claim = does_better.better(l1, robust, own)
    assert claim.finding == "holds if" and claim.condition == "L1-AC has the paper's filter (6)"
    assert claim.shows.startswith(
        "No robust MRAC beats more than 1 of 2 tuned L1-ACs. One beats Section V's in all objectives (at least 2.00-fold)"
    )
    assert "so do 1 tuned L1-ACs (best 3.00), none with (6)" in claim.shows
    weak = Side("L1-AC", ("c", "d"), np.array([[4.0, 9, 9, 9, -0.1], [5.0, 5, 5, 5, -0.3]]))
    assert does_better.better(weak, robust, own).finding == "holds"


def test_the_draws_are_even_and_the_time_constants_of_both_sides_have_one_range():
    assert does_better.L1_KNOBS["kappa"] == does_better.ROBUST_KNOBS["tau"]
    for knobs in (does_better.L1_KNOBS, does_better.ROBUST_KNOBS):
        found = does_better.drawn(knobs, does_better.BUDGET)
        for values, (low, high) in zip(found.T, knobs.values(), strict=True):
            octants = np.floor(8 * np.log(values / low) / np.log(high / low))
            assert list(np.bincount(octants.astype(int), minlength=8)) == [does_better.BUDGET // 8] * 8  # Sobol's


def test_the_robust_mracs_numbers_are_scipys():
    """The runs are nominal and with the constant disturbance, without projection on both sides."""
    t = np.linspace(0, 20, 40_001)
    for d in (0.0, 20.0):
        e, _ = by_hand.robust_mrac(lambda time: 50 * np.sin(0.5 * time), t, tau=0.5, d=lambda _, d=d: d)
        given = does_better._disturbed(section_v.problem(), does_better.DISTURBANCES["d = 20"] if d else None)
        found = figures([(given, section_v.robust_mrac("r", projection=False))], 20.0, 1e-4)
        np.testing.assert_allclose(found.max_abs_e[0], np.abs(e).max(axis=0), rtol=1e-4)


def test_the_delay_that_is_tolerated_is_that_of_the_frozen_loop_for_short_time_constants():
    """The exact limit of the frozen loop is within the bisection's last interval."""
    tau = 0.03
    robust = section_v.robust_mrac("r", tau)
    reached = does_better._reached([robust], 5e-4)
    ratio = (does_better.DELAYS[1] / does_better.DELAYS[0]) ** (0.5**does_better.HALVINGS)
    exact = tolerated(FrozenLoops(section_v.problem(), robust), DelayError()).limit
    assert -reached[0, -1] <= exact <= -ratio * reached[0, -1]
    np.testing.assert_allclose(
        reached[0, 0], figures([(section_v.problem(), section_v.robust_mrac("r", tau))], 60.0, 1e-4).max_abs_e.max(), rtol=0.02
    )
