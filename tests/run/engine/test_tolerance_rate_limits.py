"""Rate limits with a tolerance, compared with SciPy, where each change of a limiter's mode is located by hand."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat import Simulation, load_case, simulate, simulate_ensemble
from barbalat.controllers.sampled import Sampled
from barbalat.linear.systems import TransferFunction
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.actuation import PlantInput
from barbalat.signals import Square

PAPER = load_case("paper")
L1 = replace(next(c for c in PAPER.controllers if c.name == "L1"), gamma=100.0)
MRAC = replace(next(c for c in PAPER.controllers if c.name == "MRAC"), gamma=0.1)
SLOW = replace(MRAC, gamma=1e-3)  # which reaches no bound
SQUARE = replace(PAPER.problem, reference=Square(20.0, 0.37, phase=0.2))
ACTUATOR = TransferFunction([1.0], [0.03, 1.0])


def limited(problem=PAPER.problem, **others):
    return replace(problem, plant=replace(problem.plant, input=PlantInput(**others)))


def by_scipy(problem, controller, t_end, *jumps):
    """The state at t_end and the number of changes of mode, from SciPy's DOP853 at 1e-12 and the loop's Python equations.

    ``jumps`` of the demand [s] begin pieces. They are samples of the controller or jumps of the command.
    """
    loop = ClosedLoop.of(problem, controller).following_within(np.inf)
    (row,), (limit,) = loop.limiter_rows, loop.rate_limits
    tiny, x, changes = 1e-7, loop.initial(), 0
    instants = [0.0, *jumps, t_end]

    def driven(t):
        return np.array([np.asarray(one(np.array([t]))).item() for one in problem.signals])

    for begin, end in pairwise(instants):

        def signals(t, begin=begin, end=end):
            return driven(min(max(t, begin + 1e-12), end - 1e-12))

        def demand(t, x, signals=signals):
            return float(np.asarray(loop.demands(x, signals(t)))[0])

        def slope(t, x, way, signals=signals, demand=demand):
            x = x.copy()
            if way == 0:  # the plant receives the demand itself
                x[row] = demand(t, x)
            found = np.array(loop.derivative(x, signals(t)), float)
            found[row] = way * limit
            return found

        def speed(t, x, slope=slope, demand=demand, begin=begin, end=end):
            t = min(max(t, begin + 2 * tiny), end - 2 * tiny)
            rate = slope(t, x, 0)
            return (demand(t + tiny, x + tiny * rate) - demand(t - tiny, x - tiny * rate)) / (2 * tiny)

        if loop.sampled:
            x = np.asarray(loop.sample(x, driven(begin)), float)
        t, gap = begin, demand(begin, x) - x[row]
        way = int(np.sign(gap)) if abs(gap) > 1e-12 else 0
        while t < end:
            if way:
                events = [lambda t, x, way=way, demand=demand: way * (demand(t, x) - x[row])]
                events[0].direction = -1
            else:
                events = [lambda t, x, sign=sign, speed=speed: sign * speed(t, x) - limit for sign in (1, -1)]
                for one in events:
                    one.direction = 1
            for one in events:
                one.terminal = True
            how = {"rtol": 1e-12, "atol": 1e-13, "max_step": 0.005}
            found = solve_ivp(lambda t, x, way=way, slope=slope: slope(t, x, way), (t, end), x, "DOP853", events=events, **how)
            t, x = found.t[-1], np.asarray(loop.limit(found.y[:, -1]), float)
            if way == 0:
                x[row] = demand(t, x)
            if found.status == 1:
                changes += 1
                way = 0 if way else (1 if len(found.t_events[0]) else -1)
                if way == 0:
                    x[row] = demand(t, x)
                    now = speed(t, x)
                    way = int(np.sign(now)) if abs(now) > limit else 0
    return x, changes


def run(problem, controller, t_end, tolerance=1e-10):
    return simulate(problem, [controller], Simulation(t_end, tolerance=tolerance))[controller.name]


@pytest.mark.parametrize(
    ("problem", "controller", "jumps", "changes"),
    [
        (limited(rate_limit=100.0), SLOW, (), 2),
        (limited(rate_limit=60.0, saturation=(-40.0, 40.0)), SLOW, (), 1),
        (limited(rate_limit=150.0, actuator=ACTUATOR), SLOW, (), 3),
        (limited(SQUARE, rate_limit=250.0), SLOW, SQUARE.reference.breaks(0.0, 3.0), 4),
        (limited(rate_limit=150.0), Sampled(SLOW, 0.05), tuple(0.05 * np.arange(1, 60)), 24),
    ],
    ids=["alone", "a saturation", "an actuator", "jumps", "sampled"],
)
def test_the_motion_is_scipys_from_change_to_change(problem, controller, jumps, changes) -> None:
    t_end = 2.98
    expected, found_changes = by_scipy(problem, controller, t_end, *jumps)
    assert found_changes >= changes
    found = run(problem, controller, t_end)
    assert found.states[-1] == pytest.approx(expected, rel=1e-8, abs=1e-9 * np.abs(expected).max())
    free = replace(problem, plant=replace(problem.plant, input=replace(problem.plant.input, rate_limit=None)))
    assert np.abs(run(free, controller, t_end).x[-1] - found.x[-1]).max() > 1e-3


def test_in_front_of_a_delay_and_with_estimates_at_their_bounds() -> None:
    """The reference has fine fixed steps, in which the limiter lags by one step."""
    problem, fixed = limited(rate_limit=100.0, saturation=(-30.0, 30.0), delay=0.02), Simulation(3.0, 1e-5, record_points=300)
    for controller in (MRAC, L1):
        expected = simulate(problem, controller, fixed)[controller.name]
        found = simulate(problem, controller, Simulation(3.0, tolerance=1e-8, record_points=300))[controller.name]
        assert found.accuracy.error["x"] < 1e-6
        assert found.x == pytest.approx(expected.x, abs=3e-4 * np.abs(expected.x).max())


def test_the_share_of_time_at_the_limit_is_that_of_fixed_steps() -> None:
    problem = limited(rate_limit=150.0, actuator=ACTUATOR)
    ours, fixed = (simulate(problem, SLOW, one)["MRAC"] for one in (Simulation(4.0, tolerance=1e-7), Simulation(4.0, 1e-4)))
    assert 0.3 < fixed.verdict.at_rate_limit[0] < 0.9
    assert ours.verdict.at_rate_limit[0] == pytest.approx(fixed.verdict.at_rate_limit[0], abs=0.01)


def test_each_member_has_its_own_limit() -> None:
    members = [(limited(rate_limit=limit), SLOW) for limit in (80.0, 150.0, 1000.0)]
    simulation = Simulation(2.0, tolerance=1e-9)
    found = simulate_ensemble(members, simulation).metrics
    for i, (problem, controller) in enumerate(members):
        single = simulate(problem, controller, simulation)["MRAC"].figures
        assert found.theta_hat_final[i].tolist() == pytest.approx(single["theta_hat_final"], rel=1e-7)
    assert len(np.unique(found.theta_hat_final[:, 0])) == 3
