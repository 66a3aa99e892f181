"""The abstract's rows: their findings, by Theorem 1 and by V' = -|x_tilde|^2."""

import numpy as np
import pytest

from barbalat import Mrac, Simulation, load_case, simulate
from barbalat.papers.cao_hovakimyan_2006.paper import PAPER
from barbalat.papers.cao_hovakimyan_2006.sentences import COVERAGE, SENTENCES
from barbalat.papers.cao_hovakimyan_2006.transient import reference
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.tracking import l1_reference


def test_every_row_has_its_sentence():
    names = [name for part in PAPER.ledger for name in part.names]
    assert set(names) == set(SENTENCES) == {one.row for one in COVERAGE if one.row}


def test_theorem_1_bounds_the_state_and_the_input_but_not_its_distance_from_the_ideal_one():
    """At the start theta_tilde'x is in u before any gain has learnt. e, which integrates it, decreases with the gain, but u does
    not."""
    claim = reference.mrac()
    assert claim.finding == "fails" and [(one.role, one.holds) for one in claim.readings] == [
        ("literal", False),
        ("literal", False),
        ("beside", True),
    ]
    shown, over_gain = claim.listings
    largest = np.array([float(row[2]) for row in shown.rows])
    assert (largest > 0.05).all() and (largest < 1).all()  # the bounds are at most twenty times too wide
    state, control = np.array([[float(row[1]), float(row[2])] for row in over_gain.rows]).T
    assert (np.diff(np.log10(state)) < -0.4).all() and np.diff(np.log10(control))[-1] > -0.1


def test_the_ideal_control_is_that_of_the_mrac_with_theta_known():
    given = section_v.problem()
    simulation = Simulation(t_end=5.0, dt=1e-3)
    (run,) = simulate(given, [Mrac(gamma=1.0, theta_hat0=given.plant.theta)], simulation).values()
    np.testing.assert_allclose(reference._ideal_control(run.x - run.e, run.t), np.ravel(run.u), atol=1e-9 * np.abs(run.u).max())


def test_the_case_has_the_rows_runs():
    """The runs of the paper's case file equal the runs of the rows at their lowest gain."""
    (path,) = PAPER.cases
    case = load_case(path)
    runs = simulate(case.problem, case.controllers, case.simulation)
    one, other = runs["L1"], runs["L1's reference system"]
    rows = l1_reference.distances({100.0: l1_reference.STEPS[100.0]})
    assert np.abs(one.x - other.x).max() == pytest.approx(rows.state[0], rel=1e-9)
    assert np.abs(one.u - other.u).max() == pytest.approx(rows.control[0], rel=1e-9)
    assert other.metrics.max_abs_e.max() == pytest.approx(rows.model, rel=1e-9)
    error, _ = reference._over_the_gain(100.0, l1_reference.STEPS[100.0])
    assert runs["MRAC"].metrics.max_abs_e.max() == pytest.approx(error, rel=1e-9)


def test_the_distance_falls_with_the_gain_and_with_time():
    """By V' = -|x_tilde|^2 the prediction error is square integrable, and the reference system is stable."""
    assert {claim.id: claim.finding for claim in reference.l1()} == {
        "gain-enforces-transient": "holds",
        "asymptotic-tracking": "holds",
    }
