"""The loop in closed form, compared with the package's own schemes with phi = 1 and with margins known by hand."""

import numpy as np
import pytest

from barbalat import L1Adaptive, Mrac, Plant, Problem, ReferenceModel, certify, input_filter, load_case
from barbalat.certificates.linear_loops.ideal import around_equilibrium
from barbalat.papers.cao_2006.margins import constant_disturbance as loops
from barbalat.papers.cao_2006.paper import PAPER
from barbalat.papers.cao_2006.sentences import COVERAGE, SENTENCES
from barbalat.regressors import Terms
from barbalat.signals import Constant


@pytest.mark.parametrize("kappa", [None, 0.1])
def test_the_loop_is_that_of_the_schemes_with_a_constant_regressor(kappa):
    """With phi = 1, theta'phi = sigma. The loops are linearised with their law by exact Jacobians, at any command."""
    plant = Plant(A_m=[[-loops.A]], b=[loops.B], theta=[0.7], regressor=Terms(("1 + 0*x1",)))
    given = Problem(plant=plant, reference_model=ReferenceModel(k_0=1.0), reference=Constant(2.0))
    w = np.geomspace(1e-2, 1e3, 40)
    for gamma in (1.0, 1e4):
        scheme = Mrac(gamma=gamma) if kappa is None else L1Adaptive(gamma=gamma, filter=input_filter(kappa))
        found = around_equilibrium(given, scheme, 2.0).response(w)
        np.testing.assert_allclose(np.ravel(loops.loop(gamma, kappa).realise().response(w)), np.ravel(found), rtol=1e-6)


def test_the_case_has_the_rows_delay_margins():
    """The margins found from the paper's case file by linearisation equal the margins of the loop in closed form."""
    (path,) = PAPER.cases
    case = load_case(path)
    found = certify(case.problem, case.controllers, case.simulation)
    (hundred,) = np.flatnonzero(np.isclose(loops.GAINS, 100))
    for name, kappa in (("MRAC", None), ("L1", loops.KAPPAS[0])):
        margin = found[name].as_json()["delay_margin_adapting"]
        assert margin == pytest.approx(loops.over_gains(kappa).delay[hundred], rel=1e-6)


def test_the_margins_are_those_by_hand():
    """w^2/(s (s + a)) has the phase margin atan(a/w_c) with w_c^2 = (sqrt(a^4 + 4 w^4) - a^2)/2. 1/(kappa s) has a quarter turn
    and the delay margin pi kappa/2."""
    w4 = (loops.GAINS * loops.P) ** 2
    crossing = np.sqrt((np.sqrt(1 + 4 * w4) - 1) / 2)
    np.testing.assert_allclose(loops.over_gains(None).phase, np.arctan(1 / crossing), rtol=1e-6)
    for kappa in loops.KAPPAS:
        found = loops.over_gains(kappa)
        assert found.phase[-1] == pytest.approx(np.pi / 2, rel=1e-2)
        assert found.delay[-1] == pytest.approx(np.pi * kappa / 2, rel=1e-2)
    (effort, _), w2 = loops.mrac()[0].readings[:2], loops.GAINS[-1] * loops.P
    assert float(effort.measured.split()[-4]) == pytest.approx(w2 / np.sqrt(w2 - 1 / 4), rel=2e-3)  # of w2/(s^2 + s + w2)


def test_the_findings_and_the_coverage():
    rows = {row.id: row for part in PAPER.ledger for row in part.rows()}
    assert {name: row.finding for name, row in rows.items()} == {
        "high-gain-phase": "holds",
        "high-gain-delay": "holds",
        "phase-independent": "fails",  # it equals the margin of 1/(kappa s) only once the resonance no longer crosses |L| = 1
        "delay-bounded": "holds",
        "high-gain-inside": "holds",
    }
    assert set(rows) == set(SENTENCES) == {one.row for one in COVERAGE if one.row}
    assert "0.04" in rows["phase-independent"].shows
    for name in ("delay-bounded", "high-gain-inside"):
        assert "0.00049 s" in rows[name].shows and "0.0314 s" in rows[name].shows  # the dip in addition to the restored margin
