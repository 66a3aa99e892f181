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


def tried(monkeypatch, *loose: SolverPath) -> SimpleNamespace:
    """The parts that the readings on codes with automatic steps ask for; the converged solution rings by 1."""
    monkeypatch.setattr(stiff, "PAPER_SETTING", SimpleNamespace(right=(path(1.0), path(1.0))))
    right = [StiffRow("tight", "tolerance 1e-07", path(1.0), path(1.0), (0.9, 1.0))]
    rows = [StiffRow(f"code {i}", "tolerance 0.001", one, one, (0.9, 1.0)) for i, one in enumerate(loose)]
    return SimpleNamespace(automatic=right, longer=right, loose=rows)


@pytest.mark.parametrize(
    ("loose", "expected"),
    [
        ((path(1.0), path(0.1)), "not confirmed"),  # what damps too much shows no phenomenon of Figure 3
        ((path(3.0), path(0.1)), "confirmed with conditions"),
        ((path(1.0), path(1.0, lost=True)), "confirmed with conditions"),
        ((path(3.0), path(1.0, lost=True)), "confirmed"),
    ],
)
def test_the_loose_tolerance_decides(monkeypatch, loose, expected):
    found = tried(monkeypatch, *loose)
    *tight, reading = stiff._automatic(found)
    assert [one.verdict for one in tight] == ["not confirmed", "not confirmed"]
    assert reading.decides and reading.verdict == expected
    gave_up = any(one.lost for one in loose)
    (singularity,) = stiff._singularity(found)
    assert singularity.verdict == ("confirmed with conditions" if gave_up else "not confirmed")
    assert ("gives up at 0.5 s" in stiff._condition(found)) == gave_up


def test_no_reading_stands_for_what_is_not_tested(monkeypatch):
    assert all("in general" not in one.says for one in stiff._singularity(tried(monkeypatch, path(1.0))))
    assert "no reading" in stiff.NOT_TESTED
