"""The row on stiff solvers: its terms *following*, *ringing too much* and *avoiding*, and a code at a loose tolerance."""

from types import SimpleNamespace

import numpy as np
import pytest

from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.numerics import stiff
from barbalat.papers.jafari_2013.numerics.stiff_methods import SolverPath
from barbalat.papers.jafari_2013.numerics.stiff_runs import StiffRow, agrees, ratios, rings_too_much
from barbalat.run.engine.simulate import simulate
from barbalat.solvers.simulation import Simulation


def test_a_code_at_a_loose_tolerance_rings_several_times_too_much():
    """CVODES' estimates vary by 2.8 within 10 ms. RK4's estimates at h = 1e-6 s vary by 0.41, a twentieth of which is drift."""
    row = stiff.PAPER_SETTING.automatic({}, tolerance=stiff.LOOSE_TOLERANCES[0], t_end=stiff.LOOSE_END)[0]
    assert not row.boxed.lost and row.boxed.reached == stiff.LOOSE_END
    simulation = Simulation(t_end=stiff.LOOSE_END, dt=1e-6, record_points=4000)
    (run,) = simulate(section_v.problem(), [section_v.l1("L1", 1e4)], simulation).values()
    late = slice(-100, None)  # as many windows of 1 ms, ten of which make one window of the row
    most, least = (
        np.asarray(extremum)[late].reshape(10, 10, 2) for extremum in (run.envelope.theta_hat_max, run.envelope.theta_hat_min)
    )
    right = (most.max(axis=1) - least.min(axis=1)).max() / 2
    assert right == pytest.approx(0.41, abs=0.03)
    assert row.boxed.ringing(stiff.LOOSE_END - 0.1, stiff.LOOSE_END).max() > 4 * right


SPAN = (0.0, 3.0)


def path(*swings: float, lost: bool = False) -> SolverPath:
    """A path that oscillates by this much in each of three seconds around a mean that drifts by 1 per s."""
    middle = np.arange(300)[:, None] * 0.01
    swing = np.repeat(swings if len(swings) == 3 else swings * 3, 100)[:, None] + 0.005
    return SolverPath(
        least=middle - swing,
        greatest=middle + swing,
        final=middle[0],
        reached=1.0 if lost else 3.0,
        lost=lost,
        evaluations=1,
        seconds=0.0,
    )


def test_each_second_is_compared():
    right, early = path(1.0), path(1.0, 1.0, 0.5)
    assert (
        ratios(early, right, SPAN) == pytest.approx((0.5, 1.0))
        and not agrees(early, right, SPAN)
        and not rings_too_much(early, right, SPAN)
    )
    assert agrees(path(1.2, 0.9, 1.0), right, SPAN) and rings_too_much(path(1.0, 1.3, 0.1), right, SPAN)
    gave_up = path(1.0, lost=True)
    assert not agrees(gave_up, right, SPAN) and not rings_too_much(gave_up, right, SPAN)


def tried(monkeypatch, fixed: list[list[SolverPath]], *loose: SolverPath) -> SimpleNamespace:
    """The parts that the readings on all solvers need: the methods' paths at two gains. The converged solution oscillates by
    1."""
    gain = SimpleNamespace(right=(path(1.0), path(1.0)), gamma=1.0, span=SPAN)
    monkeypatch.setattr(stiff, "PAPER_SETTING", gain)
    monkeypatch.setattr(stiff, "GAINS", (gain, gain))
    rows = tuple([StiffRow(f"method {i}", "h", one, one, SPAN) for i, one in enumerate(at_gain)] for at_gain in fixed)
    codes = [StiffRow(f"code {i}", "tolerance 0.001", one, one, SPAN) for i, one in enumerate(loose)]
    return SimpleNamespace(fixed=rows, tight=[], loose=codes)


@pytest.mark.parametrize(
    ("fixed", "holds"),
    [
        ([[path(3.0), path(1.0)], [path(1.0), path(3.0)]], True),  # each fails at one of the gains
        (
            [[path(3.0), path(1.0)], [path(1.0), path(1.1)]],
            False,
        ),  # the second fails at neither, which is a counterexample to "no solver"
        (
            [[path(3.0), path(0.1)], [path(1.0), path(0.0)]],
            False,
        ),  # a method with damping does not show the phenomenon of Figure 3
        ([[path(1.0, 1.0, 2.0), path(1.0, lost=True)], [path(1.0), path(1.0)]], True),
    ],
)
def test_one_solver_that_avoids_the_phenomena_is_a_counterexample(monkeypatch, fixed, holds):
    literal, singular = stiff._literal(tried(monkeypatch, fixed))
    assert literal.holds == holds and not singular.holds


def test_a_run_that_is_lost_without_projection_shows_them(monkeypatch):
    found = tried(monkeypatch, [[path(1.0)], [path(1.0)]])
    assert not stiff._literal(found)[0].holds
    found.fixed[1][0] = found.fixed[1][0]._replace(free=path(1.0, lost=True))
    assert stiff._literal(found)[0].holds


@pytest.mark.parametrize(
    ("loose", "every", "some"),
    [
        ((path(3.0), path(3.0)), True, True),
        ((path(3.0), path(0.1)), False, True),  # some do, but not all
        ((path(1.0), path(1.0)), False, False),
        ((path(1.0, lost=True), path(3.0)), True, True),
    ],
)
def test_every_code_and_some_code(monkeypatch, loose, every, some):
    found = tried(monkeypatch, [[path(1.0)], [path(1.0)]], *loose)
    _, each, one = stiff._automatic(found)
    assert (each.holds, each.role) == (every, "weaker") and (one.holds, one.role) == (some, "beside")
    assert stiff._giving_up(found).holds == any(one.lost for one in loose)
    assert not stiff._giving_up(found).decides  # a code that gives up does not prove a singularity of the solution
