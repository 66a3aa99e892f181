"""The gain from which oscillations are predicted, beyond the plain law on phi(x) = x, compared with labels of runs on both
sides."""

import numpy as np
import pytest

from barbalat import Mrac, NormalizedMrac, ParameterBox, Plant, Problem, ReferenceModel, Sampled, certify, simulate
from barbalat.laws import Gradient
from barbalat.plants import PlantInput
from barbalat.regressors import Polynomial
from barbalat.signals import Sine
from barbalat.solvers.simulation import Simulation

AT = Simulation(t_end=20.0, dt=0.01)


def problem(theta=(1.5, -1.0), input=None, input_gain=None, **plant):
    size = len(theta)
    return Problem(
        plant=Plant(A_m=[[0.0, 1.0], [-2.0, -2.0]], b=[0.0, 1.0], theta=theta, input=input or PlantInput(), **plant),
        reference_model=ReferenceModel(k_0=2.0),
        reference=Sine(1.3, 0.9),
        uncertainty=ParameterBox([-3.0] * size, [3.0] * size),
        input_gain=input_gain,
    )


def held(gamma):
    return Sampled(controller=Mrac(gamma=gamma), sample_time=AT.dt, discretization="euler")


UNKNOWN_GAIN = problem(input=PlantInput(gain=1.2), input_gain=(0.5, 2.0))
QUADRATIC = problem(theta=(1.5, -1.0, 0.3, 0.2, -0.2), regressor=Polynomial(degree=2))
CASES = {
    "unknown input gain": (UNKNOWN_GAIN, lambda gamma: Mrac(gamma=gamma), 100.0),
    "normalised gradient": (problem(), lambda gamma: NormalizedMrac(law=Gradient(gamma=gamma)), 10.0),
    "quadratic regressor": (QUADRATIC, lambda gamma: Mrac(gamma=gamma), 4.0),
}


@pytest.mark.parametrize("name", CASES)
def test_runs_are_quiet_below_and_leave_the_region_above(name):
    given, made, ratio = CASES[name]
    (found,) = certify(given, made(10.0), AT).values()
    least, due = found.values["gamma_max"], found.values["gamma_max_at_model"]
    assert due > ratio * least
    labels = [next(iter(simulate(given, made(factor * due), AT).values())).label for factor in (0.5, 1.5)]
    assert labels[0] is None and labels[1] is not None


def test_the_law_that_takes_euler_steps_has_the_side_too():
    """At the limit, the law's discrete-time map along the model's motion, written by hand, just begins to grow."""
    given = problem()
    (found,) = certify(given, held(10.0), AT).values()
    least, due = found.values["gamma_max"], found.values["gamma_max_at_model"]
    assert due > 4 * least
    assert next(iter(simulate(given, held(1.5 * due), AT).values())).label is not None
    known, h = given.known, AT.dt
    s = 0.9j  # the maximum for the command; with x0 = 0 the response hardly overshoots the steady motion
    x = np.linalg.solve(s * np.eye(2) - known.A_m, known.b * 2.0 * 1.3)
    steady = np.sqrt((np.sum(np.abs(x) ** 2) + abs(np.sum(x**2))) / 2)  # the largest |x_m| of a period
    radii = [_radius(known, factor * due * steady**2, h) for factor in (0.7, 1.4)]
    assert radii[0] < 1 < radii[1]


def _radius(known, g, h):
    """The spectral radius. The plant's motion is a product of short Euler steps, and the law takes one Euler step."""
    pieces = 2000
    step = np.eye(3)
    flow = np.zeros((3, 3))
    flow[:2, :2], flow[:2, 2] = known.A_m, -known.b
    for _ in range(pieces):
        step = step @ (np.eye(3) + h / pieces * flow)
    step[2, :2] = h * g * (known.b @ known.P)
    return np.abs(np.linalg.eigvals(step)).max()


def test_a_plant_that_does_not_move_as_the_model_has_none():
    limit = {"saturation": (-9.0, 9.0)}
    for given, controller in (
        (problem(input=PlantInput(gain=1.2, **limit), input_gain=(0.5, 2.0)), Mrac(gamma=10.0)),
        (problem(input=PlantInput(**limit)), NormalizedMrac(law=Gradient(gamma=10.0))),
    ):
        (found,) = certify(given, controller, AT).values()
        assert "gamma_max" in found.values and "gamma_max_at_model" not in found.values


def test_a_regressor_at_rest_has_none():
    still = Problem(
        plant=Plant(A_m=[[-1.0]], b=[1.0], theta=[0.5, 0.5], regressor=Polynomial(degree=2)),
        reference_model=ReferenceModel(k_0=1.0),
        reference=Sine(0.0, 1.0),
    )
    (found,) = certify(still, Mrac(gamma=10.0), AT).values()
    assert "gamma_max_at_model" not in found.values
