"""The tolerance that a code has unless told otherwise decides the row on stiff solvers, and nothing untested does."""

from types import SimpleNamespace

import numpy as np
import pytest

from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.numerics import stiff
from barbalat.papers.jafari_2013.numerics.stiff_methods import SolverPath
from barbalat.papers.jafari_2013.numerics.stiff_runs import StiffRow
from barbalat.run.engine.simulate import simulate
from barbalat.solvers.simulation import Simulation


def test_a_code_at_a_loose_tolerance_rings_several_times_too_much():
    """CVODES' estimates swing by 1.8 within 10 ms, those of RK4 at h = 1e-6 s by 0.4."""
    (row,) = stiff.PAPER_SETTING.automatic({}, tolerance=stiff.LOOSE_TOLERANCES[0], t_end=stiff.LOOSE_END)
    assert not row.boxed.lost and row.boxed.reached == stiff.LOOSE_END
    simulation = Simulation(t_end=stiff.LOOSE_END, dt=1e-6, record_points=4000)
    (run,) = simulate(section_v.problem(), [section_v.l1("L1", 1e4)], simulation).values()
    late = slice(-100, None)  # as many windows of 1 ms; ten of them are one of the row's
    most, least = (
        np.asarray(extremum)[late].reshape(10, 10, 2) for extremum in (run.envelope.theta_hat_max, run.envelope.theta_hat_min)
    )
    right = (most.max(axis=1) - least.min(axis=1)).max() / 2
    assert right == pytest.approx(0.41, abs=0.03)
    assert row.boxed.ringing(*row.span).max() > 4 * right


def path(swing: float, *, lost: bool = False) -> SolverPath:
    least, reached = np.zeros((100, 1)), 0.5 if lost else 1.0
    return SolverPath(
        least=least, greatest=least + 2 * swing, final=least[0], reached=reached, lost=lost, evaluations=1, seconds=0.0
    )  # fmt: skip


def tried(monkeypatch, *loose: SolverPath, tight: float = 1.0) -> SimpleNamespace:
    """The parts that the readings on all solvers ask for; the converged solution rings by 1."""
    monkeypatch.setattr(stiff, "PAPER_SETTING", SimpleNamespace(right=(path(1.0), path(1.0))))
    right = [StiffRow("tight", "tolerance 1e-07", path(tight), path(tight), (0.9, 1.0))]
    rows = [StiffRow(f"code {i}", "tolerance 0.001", one, one, (0.9, 1.0)) for i, one in enumerate(loose)]
    return SimpleNamespace(fixed=right, automatic=right, longer=right, loose=rows)


@pytest.mark.parametrize(
    ("loose", "tight", "expected"),
    [
        ((path(3.0), path(3.0)), 1.0, (False, True)),  # one code that follows the equations is a counterexample to "no solver"
        ((path(3.0), path(0.1)), 1.0, (False, False)),  # what damps too much shows no phenomenon of Figure 3
        ((path(3.0), path(1.0, lost=True)), 3.0, (True, True)),
    ],
)
def test_one_solver_that_follows_is_a_counterexample(monkeypatch, loose, tight, expected):
    found = tried(monkeypatch, *loose, tight=tight)
    literal, singular = stiff._literal(found)
    assert literal.holds == expected[0] and not singular.holds
    _, at_loose = stiff._automatic(found)
    assert at_loose.holds == expected[1] and at_loose.role == "weaker"
    assert stiff._giving_up(found).holds == any(one.lost for one in loose)
    assert not stiff._giving_up(found).decides  # a code that gives up is no singularity of the solution
