"""The bundled levitation, compared with the equation of motion m y'' = m g - C i^2/y^2, integrated with SciPy."""

from __future__ import annotations

import re
from importlib import resources

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat import BaselineAlone, Simulation, load_case, simulate
from barbalat.cases.load import parse_case
from barbalat.export.in_the_loop import simulate_export
from export.targets import needs_gcc


def test_the_truth_is_the_force_law_itself() -> None:
    text = (resources.files("barbalat.cases") / "bundled" / "magnetic-levitation.toml").read_text("utf-8")
    for table in ("plant.input", "sensor.noise"):
        text = re.sub(rf"\[{re.escape(table)}\][^\[]*(\[[^\]\n]*\][^\[]*?)*(?=\n\[)", "", text, count=1)
    text = re.sub(r'kind = "square"\namplitude = .*\nfrequency = .*', 'kind = "sine"\namplitude = 0.001\nfrequency = 9.0', text)
    case = parse_case(text.replace("sample_time = 0.001\n", ""))
    assert case.problem.noise is None and case.problem.plant.paths[0].saturation is None
    run = simulate(case.problem, [BaselineAlone()], Simulation(t_end=1.0, dt=2.5e-4))["Baseline"]
    m, C, g, bias, y0 = 0.085, 1.2e-4, 9.81, 0.8596, 0.012
    k = case.problem.plant.baseline.K[0]

    def motion(t, z):
        y, rate, xi = z
        u = -k @ np.array([y - y0, rate, xi])
        return [rate, g - C / m * ((bias + u) / y) ** 2, 0.001 * np.sin(9.0 * t) - (y - y0)]

    found = solve_ivp(motion, (0.0, 1.0), [y0, 0.0, 0.0], method="DOP853", rtol=1e-11, atol=1e-14, t_eval=run.t)
    # RK4 with steps of 0.25 ms and eigenvalues of 110 rad/s: (h lambda)^4 = 6e-7 of a motion of 1 mm
    assert np.abs(run.x[:, 0] - (found.y[0] - y0)).max() < 1e-9
    assert np.abs(run.x[:, 0]).max() > 5e-4


def test_the_adaptive_laws_come_closer_than_the_lqi_alone() -> None:
    case = load_case("magnetic-levitation")
    runs = simulate(case.problem, case.controllers, case.simulation, judge=case.judge)
    tail = {name: run.figures["tail_max_abs_e"][0] for name, run in runs.items()}
    assert max(tail["MRAC"], tail["L1"]) < 0.75 * tail["Baseline"]
    assert all(run.verdict.kind.value == "follows" for run in runs.values())


@needs_gcc
@pytest.mark.full
def test_its_c_is_the_simulation_in_every_bit() -> None:
    case = load_case("magnetic-levitation")
    short = Simulation(t_end=1.0, dt=case.simulation.dt)
    for controller in case.controllers:
        origin = simulate(case.problem, [controller], short)[controller.name]
        assert simulate_export(case.problem, controller, short).differs_from(origin) == ""
