"""Runge-Kutta methods: order conditions, observed orders through the whole kernel, regions of stability."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from barbalat.controllers import L1Adaptive, Mrac
from barbalat.linear.systems import input_filter
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.state_feedback import Plant, Problem
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Step, Steps
from barbalat.solvers import EULER, HEUN, RK4, SOLVERS, Tableau
from barbalat.solvers.simulation import Simulation
from independent import integrate

# methods that are not registered, to show that nothing works only for the registered ones
MIDPOINT = Tableau("midpoint", 2, ((), (1 / 2,)), (0.0, 1.0), (0.0, 1 / 2))
KUTTA_3 = Tableau("kutta-3", 3, ((), (1 / 2,), (-1.0, 2.0)), (1 / 6, 2 / 3, 1 / 6), (0.0, 1 / 2, 1.0))
THREE_EIGHTHS = Tableau(
    "three-eighths", 4, ((), (1 / 3,), (-1 / 3, 1.0), (1.0, -1.0, 1.0)), (1 / 8, 3 / 8, 3 / 8, 1 / 8), (0.0, 1 / 3, 2 / 3, 1.0)
)
ALL = {**SOLVERS, **{m.name: m for m in (MIDPOINT, KUTTA_3, THREE_EIGHTHS)}}


def order_conditions(method):
    """The sum of b times the elementary weight of each rooted tree, and 1/(its density), by order (Hairer I, table II.2.1)."""
    s = len(method.b)
    a = np.array([[*row, *[0.0] * (s - len(row))] for row in method.a])
    b, c = np.array(method.b), np.array(method.c)
    return {
        1: [(b.sum(), 1)],
        2: [(b @ c, 1 / 2)],
        3: [(b @ c**2, 1 / 3), (b @ a @ c, 1 / 6)],
        4: [(b @ c**3, 1 / 4), (b @ (c * (a @ c)), 1 / 8), (b @ a @ c**2, 1 / 12), (b @ a @ a @ c, 1 / 24)],
    }


@pytest.mark.parametrize("name", ALL)
def test_order_conditions_hold_up_to_the_order_and_no_further(name):
    method = ALL[name]
    for order, conditions in order_conditions(method).items():
        held = all(abs(weight - wanted) < 1e-15 for weight, wanted in conditions)  # sums of four fractions
        if order <= method.order:
            assert held
        elif order == method.order + 1:
            assert not held


@pytest.mark.parametrize("name", ALL)
def test_rows_of_a_sum_to_c(name):
    for row, node in zip(ALL[name].a, ALL[name].c, strict=True):
        assert sum(row) == pytest.approx(node, abs=1e-15)


def observed_order(steps, errors):
    return -np.polyfit(np.log(steps), np.log(errors), 1)[0]


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("kind", ["mrac", "l1"])
@pytest.mark.short(kept=lambda name, kind: kind == "mrac" or name == "rk4")
def test_order_on_a_smooth_closed_loop(problems, name, kind):
    """The order is found by regression of log error over log step, through table, kernel and record. The reference has order
    eight with error control."""
    problem = problems[2]
    controller = {
        "mrac": Mrac(gamma=2.0, projection=False, name="c"),
        "l1": L1Adaptive(gamma=2.0, filter=input_filter(0.5), projection=False, name="c"),
    }[kind]
    loop = ClosedLoop.of(problem, controller)

    def derivative(t, y):
        return loop.derivative(y, np.array([float(problem.reference(np.array(t)))]))

    exact = integrate(derivative, loop.initial(), 2.0)[:2, -1]
    counts = np.array([32, 64, 128, 256])
    errors = []
    for count in counts:
        result = simulate(problem, [controller], Simulation(t_end=2.0, dt=2.0 / count, solver=ALL[name]))["c"]
        errors.append(np.abs(result.x[-1] - exact).max())
    assert min(errors) > 1e-12  # above roundings, so the slope is determined by the method
    # 0.25: the slope of four points still contains the next order's term
    assert observed_order(counts, errors) == pytest.approx(ALL[name].order, abs=0.25)


def exact_after_jumps(plant, k_0, jumps, t_end):
    """The exact x of x' = A x + b k_0 r with piecewise constant r, by matrix exponentials from jump to jump."""
    A = plant.A_m + np.outer(plant.b, plant.theta)
    x, times = plant.x0, [t for t, _ in jumps] + [t_end]
    for (start, level), stop in zip(jumps, times[1:], strict=True):
        steady = -np.linalg.solve(A, plant.b * k_0 * level)
        x = steady + expm(A * (stop - start)) @ (x - steady)
    return x


@pytest.mark.parametrize("t_end", [2.0, 2.4, 1.1, 0.7])
@pytest.mark.parametrize("kind", ["step", "steps", "disturbance"])
@pytest.mark.short(kept=lambda t_end, kind: kind == "steps" or t_end in (2.4, 0.7))
def test_a_jump_on_the_grid_keeps_the_order(t_end, kind):
    """Adaptation is off (gamma = 1e-30), so the loop is linear and the exact solution known. The jumps are at 0.3 and 0.5 s."""
    plant = Plant(A_m=[[0.0, 1.0], [-2.0, -3.0]], b=[0.0, 1.0], theta=[1.0, -0.5], x0=[0.5, -0.5])
    if kind == "steps":
        signal, jumps = Steps((0.3, 0.5), (2.0, -1.0), initial=1.0), [(0.0, 1.0), (0.3, 2.0), (0.5, -1.0)]
    else:
        signal, jumps = Step(3.0, start=0.3, constant=-1.0), [(0.0, -1.0), (0.3, 2.0)]
    problem = Problem(plant=plant, **{"disturbance" if kind == "disturbance" else "reference": signal})
    exact = exact_after_jumps(plant, 1.0, jumps, t_end)
    dts, errors = np.array([0.1, 0.05, 0.025, 0.0125]), []
    for dt in dts:
        result = simulate(problem, [Mrac(gamma=1e-30, name="c")], Simulation(t_end=t_end, dt=float(dt)))["c"]
        errors.append(np.abs(result.x[-1] - exact).max())
    assert observed_order(1 / dts, errors) == pytest.approx(4, abs=0.25)


class SilentStep:
    """A step that does not say when it jumps."""

    start = 0.30001

    def __call__(self, t):
        return 3.0 * (np.asarray(t) >= self.start)

    def before(self, t):
        return 3.0 * (np.asarray(t) > self.start)


def test_a_jump_between_two_instants_costs_the_order_where_the_signal_does_not_say_it():
    """This is the counter-test. If the signal were smoothed somewhere, the order above would prove nothing."""
    plant = Plant(A_m=[[0.0, 1.0], [-2.0, -3.0]], b=[0.0, 1.0], theta=[1.0, -0.5])
    exact = exact_after_jumps(plant, 1.0, [(0.0, 0.0), (SilentStep.start, 3.0)], 2.0)
    errors = []
    for reference in (SilentStep(), Step(3.0, start=SilentStep.start)):
        problem = Problem(plant=plant, reference=reference)
        result = simulate(problem, [Mrac(gamma=1e-30)], Simulation(t_end=2.0, dt=0.01))["MRAC"]
        errors.append(np.abs(result.x[-1] - exact).max())
    assert errors[0] > 1e-4
    assert errors[1] < 1e-8  # h^4


# --- regions of stability ---


def growth(method, z):
    """R(z) by a step for x' = z x with h = 1 from x = 1."""
    nodes = dict.fromkeys(method.nodes, 0.0)
    return method.advance(lambda x, _: z * x, lambda x: x, np.ones_like(z), nodes, 1.0)


@pytest.mark.parametrize("name", ALL)
def test_amplification_is_the_growth_of_a_step(name):
    random = np.random.default_rng(0)
    z = random.uniform(-4, 1, 200) + 1j * random.uniform(-4, 4, 200)
    np.testing.assert_allclose(ALL[name].amplification(z), growth(ALL[name], z), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("name", ALL)
def test_growth_is_that_of_the_amplification(name):
    random = np.random.default_rng(1)
    z = random.uniform(-4, 1, 200) + 1j * random.uniform(-4, 4, 200)
    np.testing.assert_allclose(ALL[name].growth(z), np.abs(growth(ALL[name], z)) ** 2 - 1, rtol=1e-12, atol=1e-12)


def test_no_method_is_stable_beyond_its_reach():
    """For random methods, some with a small coefficient in the middle, NumPy's roots give all z with R(z) = c and |c| <= 1."""
    random = np.random.default_rng(2)
    for _ in range(100):
        stages = int(random.integers(1, 5))
        a = tuple(tuple(random.uniform(-1, 1, i)) for i in range(stages))
        method = Tableau("random", 1, a, tuple(random.uniform(0.1, 1, stages)), tuple([0.0] * stages))
        polynomial = method.stability_polynomial[::-1]
        for c in np.append(0.0, np.exp(2j * np.pi * np.arange(8) / 8)):
            assert np.abs(np.roots(polynomial - c * np.eye(stages + 1)[-1])).max() <= method.reach


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("direction", [1j, -1.0])
def test_limits_against_a_scan(name, direction):
    """The limit is the first of 400 000 points up to 4 with |R| > 1 by more than rounding (1e-13)."""
    method = ALL[name]
    y = np.linspace(0, 4, 400_001)[1:]
    first = y[np.abs(growth(method, direction * y)) > 1 + 1e-13]
    scanned = first[0] if len(first) else np.inf
    limit = method.imaginary_limit if direction == 1j else method.real_limit
    # near y = 0 a growth of y^4/8 (Heun) or y^6/72 shows above 1e-13 only from y = 1e-2 or so on
    assert limit == pytest.approx(scanned, abs=2e-5 if limit else 2e-2)


def test_limits_known_from_the_literature():
    """By Hairer II, table IV.2.1 and section IV.2, Euler's and Heun's methods grow everywhere on the imaginary axis."""
    assert (EULER.imaginary_limit, HEUN.imaginary_limit, MIDPOINT.imaginary_limit) == (0.0, 0.0, 0.0)
    assert RK4.imaginary_limit == pytest.approx(2 * np.sqrt(2), rel=1e-12)
    assert THREE_EIGHTHS.imaginary_limit == pytest.approx(2 * np.sqrt(2), rel=1e-12)
    assert KUTTA_3.imaginary_limit == pytest.approx(np.sqrt(3), rel=1e-12)
    assert (EULER.real_limit, HEUN.real_limit) == (pytest.approx(2, rel=1e-12), pytest.approx(2, rel=1e-12))
    assert KUTTA_3.real_limit == pytest.approx(2.5127453266, rel=1e-9)
    assert RK4.real_limit == pytest.approx(2.7852935634, rel=1e-9)


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize(("factor", "grows"), [(0.99, False), (1.01, True)])
def test_the_real_limit_decides_over_a_simulated_decay(name, factor, grows):
    """x' = -a x with h a just below and just above the limit changes by 0.98^4000 or 1.02^4000 in 4000 steps of the kernel."""
    solver, dt = SOLVERS[name], 2.0**-6
    plant = Plant(A_m=[[-factor * solver.real_limit / dt]], b=[1.0], theta=[0.0], x0=[1.0])
    result = simulate(Problem(plant=plant), [Mrac(gamma=1e-30)], Simulation(t_end=4000 * dt, dt=dt, solver=solver))["MRAC"]
    assert (result.diverged_at is not None) == grows
    if not grows:
        assert abs(result.x[-1, 0]) < 1e-3
