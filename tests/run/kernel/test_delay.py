"""Unmodelled input dynamics and the exact delay, compared with the method of steps, matrix exponentials and the linear margin."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat import (
    InputError,
    Mrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Simulation,
    TransferFunction,
    simulate,
    simulate_ensemble,
)
from barbalat.certificates.linear_loops.ideal import known_parameters
from barbalat.linear.margins import margins
from barbalat.plants import PlantInput
from barbalat.run.kernel import delay as exact_delay
from barbalat.signals import Sine
from barbalat.solvers import RK4, SOLVERS
from barbalat.studies import Budget

A_M, B, THETA = np.array([[0.0, 1.0], [-1.0, -1.4]]), np.array([0.0, 1.0]), np.array([0.7, -0.5])


def problem(**dynamics) -> Problem:
    return Problem(
        plant=Plant(A_m=A_M, b=B, theta=THETA, x0=[0.3, 0.0], input=PlantInput(**dynamics) if dynamics else None),
        reference_model=ReferenceModel(k_0=2.0),
        reference=Sine(amplitude=1.0, frequency=1.3, phase=0.4),
        uncertainty=ParameterBox(lower=[-2, -2], upper=[2, 2]),
    )


def method_of_steps(given: Problem, gamma: float, t_end: float) -> np.ndarray:
    """x at t_end by DOP853 from one multiple of the delay to the next, with the past from its dense output."""
    tau, r, P = given.delay, given.reference, given.known.P
    pieces: list = []

    def control(y, t):
        return -y[4:6] @ y[:2] + 2.0 * r(np.array([t]))[0]

    def past_input(t):
        # the last piece covers the delay interval before the current one
        return control(pieces[-1](t), t) if pieces else given.history[0]

    def slope(t, y):
        x, x_m = y[:2], y[2:4]
        x_dot = A_M @ x + B * (THETA @ x + past_input(t - tau))
        x_m_dot = A_M @ x_m + B * 2.0 * r(np.array([t]))[0]
        return np.concatenate([x_dot, x_m_dot, gamma * ((x - x_m) @ P @ B) * x])

    y, t = np.array([0.3, 0, 0.3, 0, 0, 0.0]), 0.0
    while t < t_end - 1e-12:
        stop = min(t + tau, t_end)
        done = solve_ivp(slope, (t, stop), y, method="DOP853", rtol=1e-12, atol=1e-12, dense_output=True)
        pieces.append(done.sol)
        y, t = done.y[:, -1], stop
    return y


@pytest.mark.parametrize("tau", [0.1, 0.1234567, 0.02])
@pytest.mark.parametrize("history", [0.0, 1.5])
def test_against_the_method_of_steps(tau, history):
    """u jumps from the history at t = 0. This causes no error, but u has a bend one delay later, and across a bend the order is
    2."""
    given, gamma, t_end = problem(delay=tau, history=history), 3.0, 1.5
    reference = method_of_steps(given, gamma, t_end)
    steps, errors = np.array([1e-2, 5e-3, 2.5e-3]), []
    for h in steps:
        (run,) = simulate(given, [Mrac(gamma=gamma)], Simulation(t_end=t_end, dt=h)).values()
        errors.append(np.abs(run.x[-1] - reference[:2]).max())
        assert np.abs(run.theta_hat[-1] - reference[4:6]).max() < 20 * errors[-1]
    assert errors[-1] < 1e-6
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] > 1.8


def test_fourth_order_where_the_input_is_smooth():
    """From zero with a command that starts smoothly, the past has no jump, and RK4 keeps its order for any delay."""

    class SmoothStart:
        def __call__(self, t):
            return np.where(t > 0, (1 - np.cos(t)) ** 3, 0.0)  # five continuous derivatives at 0

        before = __call__

    given = Problem(
        plant=Plant(A_m=A_M, b=B, theta=THETA, input=PlantInput(delay=0.0777)),
        reference_model=ReferenceModel(k_0=2.0),
        reference=SmoothStart(),
    )
    steps = np.array([1e-2, 5e-3, 2.5e-3])
    runs = [simulate(given, [Mrac(gamma=2.0)], Simulation(t_end=4.0, dt=h))["MRAC"].x[-1] for h in (*steps, 1e-4)]
    errors = [np.abs(x - runs[-1]).max() for x in runs[:-1]]
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 3.5 < order < 5


def test_linear_delay_margin_is_observed():
    """With the estimates frozen on theta the simulated loop loses stability where the linear margin says."""
    plant = Plant(A_m=[[0, 1], [-0.3, -1]], b=[0, 1], theta=[4, -3], x0=[1, 1])
    margin = margins(known_parameters(plant, plant.theta)).delay
    members = []
    for factor in (0.97, 1.03):
        delayed = Plant(A_m=plant.A_m, b=plant.b, theta=plant.theta, x0=plant.x0, input=PlantInput(delay=margin * factor))
        members.append((Problem(plant=delayed), Mrac(gamma=1e-30, theta_hat0=[4, -3])))
    early = simulate_ensemble(members, Simulation(t_end=300, dt=2e-3)).metrics
    late = simulate_ensemble(members, Simulation(t_end=900, dt=2e-3)).metrics
    growth = late.tail_max_abs_e[:, 0] / early.tail_max_abs_e[:, 0]
    assert growth[0] < 1 < growth[1]


def test_members_with_different_delays_equal_single_runs():
    rng = np.random.default_rng(2)
    simulation = Simulation(t_end=3, dt=1e-3)
    delays = rng.uniform(2e-3, 0.2, 19)
    members = [(problem(delay=float(tau)), Mrac(gamma=float(rng.uniform(1, 5)))) for tau in delays]
    results = [
        simulate_ensemble(members, simulation, lanes=lanes, threads=threads).metrics
        for lanes, threads in ((1, 1), (4, 2), (16, 1))
    ]
    for name in results[0].__dataclass_fields__:
        for other in results[1:]:
            np.testing.assert_array_equal(getattr(results[0], name), getattr(other, name))
    for i in (0, 7, 18):
        (alone,) = simulate(*[members[i][0], [members[i][1]], simulation]).values()
        np.testing.assert_allclose(results[0].max_abs_e[i], alone.figures["max_abs_e"], rtol=1e-9)


def test_actuator_and_multiplicative_are_what_they_say():
    """1 + Delta_m is given in both forms, and the actuator is two more states of a DOP853 reference."""
    num, den = [100.0], [1.0, 14.0, 100.0]
    as_actuator = problem(actuator=TransferFunction(num, den))
    as_uncertainty = problem(multiplicative=TransferFunction(np.polysub(num, den), den))
    simulation = Simulation(t_end=4, dt=1e-3)
    (one,), (other,) = (simulate(p, [Mrac(gamma=2.0)], simulation).values() for p in (as_actuator, as_uncertainty))
    np.testing.assert_allclose(one.x, other.x, atol=1e-11)
    P, r = as_actuator.known.P, as_actuator.reference

    def slope(t, y):
        x, x_m, theta_hat, a = y[:2], y[2:4], y[4:6], y[6:]
        u = -theta_hat @ x + 2.0 * r(np.array([t]))[0]
        return np.concatenate([
            A_M @ x + B * (THETA @ x + 100 * a[0]),
            A_M @ x_m + B * 2.0 * r(np.array([t]))[0],
            2.0 * ((x - x_m) @ P @ B) * x,
            [a[1], -100 * a[0] - 14 * a[1] + u],
        ])  # fmt: skip

    done = solve_ivp(slope, (0, 4), [0.3, 0, 0.3, 0, 0, 0, 0, 0], method="DOP853", rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(one.x[-1], done.y[:2, -1], atol=1e-9)


def test_weights_are_exact_for_cubics():
    rng = np.random.default_rng(0)
    dt = 0.01
    for tau in (0.01, 0.0137, 0.02, 0.0234, 0.31, 0.05999999999):
        cubic = np.polynomial.Polynomial(rng.normal(size=4))
        lag = exact_delay.lag(tau, dt)
        k = 40
        starts, ends = ([cubic((k - lag - tap + end) * dt) for tap in range(3)] for end in (0, 1))
        expected = [cubic((k + node) * dt - tau) for node in RK4.nodes]
        np.testing.assert_allclose(exact_delay.weights(tau, dt, RK4) @ [*starts, *ends], expected, atol=1e-12)


def test_bad_input_dynamics():
    with pytest.raises(
        exact_delay.DelayTooShortError, match=r"plant\.input\.delay.*at least one solver step.*at most 0\.001"
    ) as e:
        simulate(problem(delay=0.001), [Mrac(gamma=1)], Simulation(t_end=1, dt=2e-3))
    assert (e.value.delay, e.value.dt) == (0.001, 2e-3)
    simulate(problem(delay=e.value.delay), [Mrac(gamma=1)], Simulation(t_end=1, dt=e.value.delay))
    with pytest.raises(InputError, match=r"plant\.input\.history must be a"):
        PlantInput(history="1")
    with pytest.raises(InputError, match=r"plant\.input\.delay must not be negative"):
        PlantInput(delay=-1)
    with pytest.raises(InputError, match=r"plant\.input\.actuator must be proper and stable"):
        PlantInput(actuator=TransferFunction([1, 0], [1]))
    with pytest.raises(InputError, match=r"plant\.input\.multiplicative must be proper and stable"):
        PlantInput(multiplicative=TransferFunction([1], [1, -1]))


def test_what_long_delays_remember_is_counted_before_it_is_allocated(monkeypatch):
    """10^7 steps with 2 values each are rounded up to 2^24 steps, which need 268 MB for each run."""
    simulation = Simulation(t_end=1.0, dt=2.0**-20)
    given = problem(delay=1e7 * 2.0**-20)
    monkeypatch.setattr(exact_delay, "free_memory", lambda: 20 * 2**24 * 16)
    controllers = [Mrac(gamma=1.0, name=f"M{i}") for i in range(20)]
    for attempt in (
        lambda: simulate(given, controllers, simulation),
        lambda: simulate_ensemble([(given, controllers[0])] * 20, simulation),
    ):
        with pytest.raises(InputError, match=r"20 runs stores, would take about 5 GiB of memory.*at most 8388605 steps"):
            attempt()
        with (
            Budget(memory=2.0**33),
            pytest.raises(InputError, match=r"needs 5\.37 GB of memory for 20 runs, but only 5\.37 GB are free"),
        ):
            attempt()
    monkeypatch.undo()
    assert exact_delay.free_memory() is None or exact_delay.free_memory() > 1e6
    exact_delay.require_memory(0.5, 1, 3, simulation.dt)


@pytest.mark.parametrize("solver", SOLVERS.values(), ids=str)
def test_weights_as_a_list_are_the_weights(solver):
    """For whole steps the results are bit-identical. For other delays the difference is a few roundings of a sum of terms up to
    10."""
    for delay in (0.05, 0.0537, 0.01 + 1e-9, 0.0999):
        wanted = exact_delay.weights(delay, 0.01, solver)
        found = exact_delay.weights(delay, 0.01, solver, fused=False)
        np.testing.assert_allclose(found, wanted, atol=0.0 if delay == 0.05 else 1e-13, rtol=0)
