"""The controller with known parameters: its loop equals the reference model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim, lti

from barbalat import KnownParameters, certify
from barbalat.cases.load import load_case
from barbalat.certificates.certificates import table_1
from barbalat.comparison.grids import reach_of
from barbalat.controllers import LinearFeedback
from barbalat.linear.systems import TransferFunction
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.actuation import PlantInput
from barbalat.problem.regressors import Terms
from barbalat.problem.state_feedback import Plant, Problem, ReferenceModel
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Sine, Step
from barbalat.solvers.simulation import Simulation
from independent import refusal, symbols_against_numbers


def ideal(problem):
    return KnownParameters(theta=problem.parameters)


@pytest.mark.parametrize("gain", [None, (0.3, 2.0)])
@pytest.mark.parametrize("regressor", [None, Terms(terms=("x1*x2", "sin(x1)"))])
def test_the_loop_is_the_model(problems, gain, regressor):
    """For any phi(x) and any gain of the plant, e stays at the roundings of about 1e4 steps."""
    problem, path = problems[2], PlantInput(gain=0.6)
    plant = problem.plant if regressor is None else replace(problem.plant, regressor=regressor)
    if gain is not None:
        problem, plant = replace(problem, input_gain=gain), replace(plant, input=path)
    problem = replace(problem, plant=plant)
    run = simulate(problem, [ideal(problem)], Simulation(t_end=20.0, dt=1e-3))["Known parameters"]
    assert np.abs(run.x_m).max() > 0.1
    assert max(run.figures["max_abs_e"]) < 1e-11 * np.abs(run.x_m).max()
    assert (run.theta_hat == problem.parameters).all()
    symbols_against_numbers(ClosedLoop.of(problem, ideal(problem)), size=3.0)


def test_a_disturbance_moves_the_error_through_the_model_alone():
    """e' = A_m e + b d agrees with SciPy's response to a step, which is exact on its grid."""
    A_m, b = np.array([[0.0, 1.0], [-0.3, -1.0]]), np.array([0.0, 1.0])
    plant = Plant(A_m=A_m, b=b, theta=[4.0, -3.0], x0=[1.0, 1.0])
    problem = Problem(
        plant=plant, reference_model=ReferenceModel(k_0=4.0), reference=Sine(5.0, 0.5), disturbance=Step(amplitude=2.0, start=0.0)
    )
    run = simulate(problem, [ideal(problem)], Simulation(t_end=10.0, dt=1e-3, record_points=1000))["Known parameters"]
    _, expected, _ = lsim(lti(A_m, b[:, None], np.eye(2), np.zeros((2, 1))), np.full(len(run.t), 2.0), run.t)
    np.testing.assert_allclose(run.e, expected, atol=1e-10)


def test_several_inputs_and_refusals(problems):
    A_m, B = np.array([[-1.0, 0.5], [0.0, -2.0]]), np.array([[1.0, 0.2], [-0.3, 1.0]])
    plant = Plant(A_m=A_m, b=B, theta=np.array([[0.5, -1.0], [-0.7, 0.2]]), x0=[0.3, -0.2])
    reference = (Sine(1.0, 1.0), Sine(0.5, 2.3))
    problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=np.eye(2)), reference=reference)
    run = simulate(problem, [ideal(problem)], Simulation(t_end=10.0, dt=1e-3))["Known parameters"]
    assert max(run.figures["max_abs_e"]) < 1e-12
    assert "theta must have shape 2" in refusal(lambda: KnownParameters(theta=[1.0]).bind(problems[2].known))
    assert "name" in refusal(lambda: KnownParameters(theta=[1.0], name=""))


def test_table_1_claims_it_where_the_parameters_are_the_plants(problems):
    problem = problems[2]
    for theta, text, kind in (
        (problem.parameters, "e is zero", "guaranteed"),
        (
            problem.parameters + 0.1,
            "for every r and d within the case's bounds, with the case's theta and input gain only",
            "does not apply",
        ),
    ):
        controller = KnownParameters(theta=theta)
        found = certify(problem, [controller], Simulation(t_end=20.0, dt=1e-3))
        (column,) = table_1(problem, [controller], found).columns
        assert column.cells["tracking"].kind == kind
        assert column.cells["transient"].kind == "guaranteed" and text in column.cells["transient"].text


def test_controllers_without_estimates_assume_the_declared_values_of_the_parameters_and_not_the_middle_of_the_set():
    case = load_case("flexible-joint")
    known, plant = case.problem.known, case.problem.plant
    assert np.abs(known.theta_set.middle - plant.nominal_theta).max() > 0.1
    fixed = LinearFeedback(controller=TransferFunction([1.0], [1.0, 1.0])).bind(known)
    np.testing.assert_array_equal(fixed.theta_0, plant.nominal_theta)
    np.testing.assert_array_equal(reach_of(case.problem, case.simulation)[0].nominal, plant.nominal_theta)
