"""Limits of MRAC with output feedback, compared with formulas and runs."""

from __future__ import annotations

import numpy as np
import pytest

from barbalat import Simulation, simulate
from barbalat.cases.load import load_case
from barbalat.certificates.certify import certify

MATCHED = """
name = "matched"
[plant]
transfer_function = { num = [2.0], den = [1.0, 1.0] }
[reference_model]
transfer_function = { num = [3.0], den = [1.0, 3.0] }
[reference]
kind = "constant"
value = 1.5
[simulation]
t_end = 20.0
dt = 1e-3
[[controller]]
scheme = "mrac-output"
order = 1
relative_degree = 1
sign = 1
law = { kind = "lyapunov", gamma = GAMMA }
"""


def matched(tmp_path, gamma):
    path = tmp_path / "matched.toml"
    path.write_text(MATCHED.replace("GAMMA", f"{gamma!r}"))
    return load_case(path)


@pytest.mark.parametrize("gamma", [1.0, 1e4])
def test_output_feedback_turns_with_the_high_frequency_gain(tmp_path, gamma):
    """For y' = -y + 2 u, omega_a^2 = Gamma (y^2 + r^2) 2, and y is at most the output of the model, whose L1 norm is 1."""
    case = matched(tmp_path, gamma)
    (found,) = certify(case.problem, case.controllers, case.simulation).values()
    assert found.values["adaptation_frequency"] == pytest.approx(np.sqrt(gamma * 2 * 1.5**2 * 2), rel=1e-6)
    # s^2 + 3 s + omega_a^2 around the estimates theta*
    wanted = np.roots([1.0, 3.0, found.values["adaptation_frequency"] ** 2])
    steps = [h for h in np.geomspace(1e-5, 10, 4000) if (np.abs(case.simulation.solver.amplification(h * wanted)) > 1).any()]
    assert found.values["step_max"] == pytest.approx(min(steps), rel=0.02)
    again = matched(tmp_path, found.values["gamma_max"])
    (at_limit,) = certify(again.problem, again.controllers, again.simulation).values()
    assert at_limit.values["step_max"] == pytest.approx(case.simulation.dt, rel=1e-2)


def test_output_feedback_below_and_above_its_step(tmp_path):
    case = matched(tmp_path, 1e4)
    (found,) = certify(case.problem, case.controllers, case.simulation).values()
    for factor, labelled in ((0.9, False), (1.5, True)):
        steps = round(20.0 / (factor * found.values["step_max"]))
        (run,) = simulate(case.problem, case.controllers, Simulation(t_end=20.0, dt=20.0 / steps)).values()
        assert (run.label is not None) is labelled


def test_rohrs_controllers_have_limits():
    case = load_case("rohrs")
    for name, found in certify(case.problem, case.controllers, case.simulation).items():
        assert found.values["step_max"] > 0, name
        assert "step_max" not in found.guaranteed
