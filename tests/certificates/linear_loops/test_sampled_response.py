"""Bounds of sampled linear loops for all commands and disturbances of given sizes: attacked by the worst ones, in simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import (
    Adrc,
    KnownParameters,
    L1PiecewiseConstant,
    LinearFeedback,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Sampled,
    Simulation,
    TransferFunction,
    certify,
    input_filter,
    simulate,
)
from barbalat.cases.load import load_case
from barbalat.certificates.linear_loops.sampled_response import response
from barbalat.plants import Disturbance, PlantInput, Sensor
from barbalat.signals import Sine, Square, Steps

T, DT, T_END = 0.05, 0.0025, 12.0
PATHS = {
    "nothing": PlantInput(),
    "delay": PlantInput(delay=0.03),
    "actuator and two samples": PlantInput(delay=0.11, actuator=TransferFunction([20.0], [1.0, 20.0])),
    "a gain": PlantInput(gain=0.8, delay=0.05),
}
CONTROLLERS = {
    "adrc": Sampled(Adrc(bandwidth=8.0), T),
    "adrc, euler": Sampled(Adrc(bandwidth=4.0), T, discretization="euler"),
    "linear": Sampled(
        LinearFeedback(controller=TransferFunction([2.0, 3.0], [1.0, 5.0]), output=[1.0, 0.5], nominal=[0.2, 0.1]), T
    ),
    "known": Sampled(KnownParameters(theta=[0.4, -0.3]), T, discretization="euler"),
    "piecewise": L1PiecewiseConstant(sample_time=T, filter=input_filter(0.3)),
}


def problem_of(path, **fields):
    return Problem(
        plant=Plant(A_m=[[0.0, 1.0], [-2.0, -2.0]], b=[0.2, 1.0], theta=[0.6, -0.4], x0=[0.1, -0.2], input=PATHS[path]),
        reference_model=ReferenceModel(k_0=2.0),
        uncertainty=ParameterBox(lower=[-1, -1], upper=[1, 1]),
        **fields,
    )


def drawn_steps(random, size):
    """A command that jumps from end to end at samples, as often as it likes."""
    times = np.cumsum(random.integers(1, random.integers(2, 60), 200)) * T
    return Steps(times=tuple(times), values=tuple(size * random.choice([-1.0, 1.0], 200)), initial=size * random.choice([-1, 1]))


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.short(kept=lambda name, path: (name, path) in (("adrc", "delay"), ("piecewise", "actuator and two samples")))
def test_no_command_and_no_disturbance_exceeds_them(name, path, sample):
    random = np.random.default_rng([len(name), len(path)])
    controller = CONTROLLERS[name]
    for _ in range(sample(3, 8)):
        sizes = random.uniform(0.2, 2.0, 3)
        problem = problem_of(
            path,
            reference=drawn_steps(random, sizes[0]),
            disturbance=drawn_steps(random, sizes[1]),
            unmatched=(Disturbance([1.0, -0.5], Sine(amplitude=sizes[2], frequency=random.uniform(0.3, 5.0))),),
            sensor=Sensor(lag=0.02) if random.random() < 0.5 else None,
        )
        (found,) = certify(problem, [controller], Simulation(t_end=T_END, dt=DT)).values()
        if found.values["spectral_radius"] >= 1:
            continue
        assert {"error_bound", "state_bound", "control_bound"} <= found.guaranteed
        (run,) = simulate(problem, [controller], Simulation(t_end=T_END, dt=DT)).values()
        assert max(run.figures["max_abs_e"]) <= found.values["error_bound"] * (1 + 1e-6)
        assert run.figures["max_abs_u"] <= found.values["control_bound"] * (1 + 1e-6)
        assert np.abs(run.x).max() <= found.values["state_bound"] * (1 + 1e-6)


@pytest.mark.parametrize("name", ["adrc", "piecewise"])
def test_the_worst_command_comes_close(name):
    """Its signs are those of the impulse response backwards, which a run gives: nothing of the bound's own arithmetic."""
    controller, count = CONTROLLERS[name], 160
    still = replace(problem_of("delay"), plant=replace(problem_of("delay").plant, x0=[0.0, 0.0]))
    pulse = replace(still, reference=Steps(times=(0.0, T), values=(1.0, 0.0)))
    simulation = Simulation(t_end=count * T, dt=DT)
    (run,) = simulate(pulse, [controller], simulation).values()
    bound = response(still, controller, np.array([1.0]), np.zeros(0))
    at_samples = np.abs(run.t[:, None] - np.arange(1, count) * T).argmin(axis=0)
    signs = np.sign(run.x[at_samples][::-1])
    reached = []
    for i in range(2):
        worst = Steps(times=tuple(np.arange(count - 1) * T), values=tuple(signs[:, i]))
        (run,) = simulate(replace(still, reference=worst), [controller], simulation).values()
        reached.append(np.abs(run.x[:, i]).max())
    assert 0.9 * bound.x <= max(reached) <= bound.x


def test_limits_that_u_may_reach_leave_no_bound():
    path = PlantInput(delay=0.03, saturation=[-0.5, 0.5])
    problem = replace(problem_of("delay", reference=Square(amplitude=1.0, frequency=0.5)))
    problem = replace(problem, plant=replace(problem.plant, input=path))
    (found,) = certify(problem, [CONTROLLERS["adrc"]], Simulation(t_end=1.0, dt=DT)).values()
    entry = found.entry("error_bound")
    assert not entry.applies and "u may reach" in entry.why
    wide = replace(problem, plant=replace(problem.plant, input=PlantInput(delay=0.03, saturation=[-50.0, 50.0])))
    (found,) = certify(wide, [CONTROLLERS["adrc"]], Simulation(t_end=1.0, dt=DT)).values()
    assert "error_bound" in found.guaranteed


def test_the_quadrotor_has_a_guaranteed_bound_that_its_run_keeps():
    case = load_case("quadrotor-pitch")
    certificates, runs = (
        certify(case.problem, case.controllers, case.simulation),
        simulate(case.problem, case.controllers, case.simulation),
    )
    bounded = [name for name, one in certificates.items() if "error_bound" in one.guaranteed]
    assert bounded == ["L1, exact", "L1, as flown", "ADRC"]
    for name in bounded:
        assert max(runs[name].figures["max_abs_e"]) <= certificates[name].values["error_bound"]
