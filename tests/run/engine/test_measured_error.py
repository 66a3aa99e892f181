"""The measured error of fixed steps, compared with sufficiently fine steps."""

from dataclasses import replace

import numpy as np
import pytest

from barbalat import Simulation, load_case, simulate
from barbalat.controllers.sampled import Sampled
from barbalat.problem.actuation import PlantInput
from barbalat.run.engine.check_numerics import check_numerics

PAPER = load_case("paper")
MRAC = replace(next(c for c in PAPER.controllers if c.name == "MRAC"), gamma=1.0)


@pytest.mark.parametrize(
    ("controller", "problem"),
    [
        (MRAC, PAPER.problem),
        (Sampled(MRAC, 0.02), replace(PAPER.problem, plant=replace(PAPER.problem.plant, input=PlantInput(delay=0.03)))),
    ],
    ids=["continuous", "sampled and delayed"],
)
def test_it_is_the_difference_from_fine_steps(controller, problem) -> None:
    """Steps a 200th as long have a far smaller error. Both record the same instants."""
    coarse = simulate(problem, [controller], Simulation(2.0, 1e-2))
    found = check_numerics(coarse, measured=True)["MRAC"]
    fine = simulate(problem, [controller], Simulation(2.0, 5e-5, record_points=40_000))["MRAC"]
    theta_hat = fine.theta_hat[np.searchsorted(fine.t, found.t - 1e-9)]
    expected = (np.abs(found.theta_hat - theta_hat).max(axis=0) / np.abs(theta_hat).max(axis=0)).max()
    assert expected > 1e-7
    assert found.measured_error is not None
    assert found.measured_error.error["theta_hat"] == pytest.approx(expected, rel=1e-2)
    assert found.measured_error.own["theta_hat"] < expected / 100
    assert found.measured_error.sentence in found.numerics
    assert found.figures == coarse["MRAC"].figures


def test_why_none_is_measured() -> None:
    converted = replace(PAPER.problem, plant=replace(PAPER.problem.plant, input=PlantInput(quantization=0.1)))
    found = check_numerics(simulate(converted, [MRAC], Simulation(1.0, 5e-3)), measured=True)["MRAC"].measured_error
    assert found.sentence.startswith("error not measured: simulation.tolerance cannot be used with floor")
    assert found.as_json()["error"] == {}


def test_up_to_a_divergence() -> None:
    case = load_case("rohrs")
    classical = next(c for c in case.controllers if c.name == "Classical")
    found = check_numerics(simulate(case.problem, [classical], Simulation(30.0, 1e-3)), measured=True)["Classical"]
    assert found.diverged_at is not None
    assert found.measured_error.until <= found.diverged_at


def test_a_run_with_a_tolerance_has_its_own() -> None:
    found = check_numerics(simulate(PAPER.problem, [MRAC], Simulation(0.5, tolerance=1e-6)), measured=True)["MRAC"]
    assert found.measured_error is None
    assert found.accuracy is not None
