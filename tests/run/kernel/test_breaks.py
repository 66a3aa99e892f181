"""Jumps and corners within steps: the method keeps its order, step counters do not count pieces, and a loss of order is
reported."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat.adaptation.laws.least_squares import LeastSquaresBounded
from barbalat.adaptation.modifications import DeadZone, EpsilonModification, SwitchingSigma
from barbalat.controllers import L1Adaptive, Mrac, RobustMrac, Sampled
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import ParameterBall, ParameterBox
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.plant import Plant, ReferenceModel
from barbalat.problem.regressors import Terms
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import BreakingSignal
from barbalat.report.documents import run_block
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.run.kernel.breaks import breaks_inside, can_be_split, lost_order
from barbalat.run.kernel.grid import signal_table
from barbalat.signals import Chirp, Constant, Recorded, Sine, Sines, Square, Step, Steps
from barbalat.signals.smooth import Clock
from barbalat.solvers import EULER, HEUN, RK4
from barbalat.solvers.simulation import Simulation
from foreign import wrong

A_M, B, THETA = np.array([[0.0, 1.0], [-2.0, -1.5]]), np.array([0.3, 1.0]), np.array([0.8, -0.5])
X0, K_0, GAMMA, T_END = np.array([0.2, -0.1]), 1.5, 0.5, 2.0
EDGES = 0.71 * np.arange(1, 6)
DATA = Recorded(times=[0.1234, 0.37, 0.771, 1.3, 1.666], values=[1.0, -2.0, 3.0, 3.0, 0.5])
BREAKING = {
    "step": (Step(amplitude=2.0, start=0.7123, constant=-1.0), [0.7123]),
    "steps": (Steps(times=(0.333, 0.3391, 1.7), values=(1.0, 3.0, -2.0), initial=0.5), [0.333, 0.3391, 1.7]),
    "square": (Square(amplitude=2.0, frequency=np.pi / 0.71), EDGES),
    "square with a phase": (Square(amplitude=2.0, frequency=np.pi / 0.71, phase=np.pi * 0.3), EDGES - 0.213),
    "chirp": (Chirp(amplitude=2.0, frequency_start=9.0, frequency_end=1.0, duration=1.2345), [1.2345]),
    "csv": (DATA, DATA.times),
}
"""Signals with the instants at which they or a derivative jump. The instants are written by hand and not taken from the
signal."""


@dataclass(frozen=True)
class Tanh:
    """A command through a nonlinearity, so jumps enter the loop with a different size."""

    of: Square

    def __call__(self, t):
        return np.tanh(self.of(t))

    def before(self, t):
        return np.tanh(self.of.before(t))

    def breaks(self, start, stop):
        return self.of.breaks(start, stop)


def problem(reference, **parts) -> Problem:
    plant = Plant(A_m=A_M, b=B, theta=THETA, x0=X0, **parts)
    return Problem(plant=plant, reference_model=ReferenceModel(k_0=K_0), reference=reference)


def exactly(given: Problem, command, corners, *, level=np.inf, regressor=lambda x: x) -> np.ndarray:
    """(x, x_m, theta_hat) of MRAC at T_END by DOP853 from break to break, with the command's values just inside each piece."""
    P, y = given.known.P, np.concatenate([X0, X0, 0 * given.plant.theta])
    times = [0.0, *(t for t in corners if 0 < t < T_END), T_END]
    for start, stop in pairwise(times):
        inside = 1e-9 * (stop - start)

        def slope(t, y, start=start + inside, stop=stop - inside):
            x, x_m, theta_hat = y[:2], y[2:4], y[4:]
            r, phi = float(command(np.clip(t, start, stop))), regressor(x)
            v = np.clip(-theta_hat @ phi + K_0 * r, -level, level)
            x_dot = A_M @ x + B * (given.plant.theta @ phi + v)
            return np.concatenate([x_dot, A_M @ x_m + B * K_0 * r, GAMMA * ((x - x_m) @ P @ B) * phi])

        y = solve_ivp(slope, (start, stop), y, method="DOP853", rtol=1e-13, atol=1e-14, max_step=0.02).y[:, -1]
    return y


def observed(given: Problem, expected, solver=RK4, steps=(1 / 48, 1 / 96, 1 / 192)) -> tuple[float, list[float]]:
    """The order by regression, and the errors. The breaks are at different fractions of the steps."""
    errors = []
    for h in steps:
        run = simulate(given, [Mrac(gamma=GAMMA)], Simulation(t_end=T_END, dt=h, solver=solver))["MRAC"]
        found = np.concatenate([run.x[-1], run.x_m[-1], run.theta_hat[-1]])
        errors.append(float(np.abs(found - expected).max()))
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0]), errors


@pytest.mark.parametrize("kind", BREAKING)
def test_every_kind_of_signal_keeps_the_method_s_order(kind):
    signal, corners = BREAKING[kind]
    given = problem(signal)
    expected = exactly(given, signal, corners)
    for solver in (EULER, HEUN, RK4):
        order, _ = observed(given, expected, solver)
        assert order == pytest.approx(solver.order, abs=0.2), solver.name


def test_a_disturbance_keeps_it_too():
    """The command and the disturbance jump at different times. x' has the term b d, as MRAC's plant with d/1 added to the
    input."""
    command, disturbance = BREAKING["square"][0], BREAKING["steps"][0]
    given = replace(problem(command), disturbance=disturbance)
    P, y = given.known.P, np.concatenate([X0, X0, [0.0, 0.0]])
    for start, stop in pairwise([0.0, *sorted([*EDGES[EDGES < T_END], *BREAKING["steps"][1]]), T_END]):
        r, d = (float(s(np.array((start + stop) / 2))) for s in (command, disturbance))

        def slope(_, y, r=r, d=d):
            x, x_m, theta_hat = y[:2], y[2:4], y[4:]
            x_dot = A_M @ x + B * (THETA @ x + d - theta_hat @ x + K_0 * r)
            return np.concatenate([x_dot, A_M @ x_m + B * K_0 * r, GAMMA * ((x - x_m) @ P @ B) * x])

        y = solve_ivp(slope, (start, stop), y, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    order, _ = observed(given, y)
    assert order == pytest.approx(4, abs=0.2)


@pytest.mark.parametrize("way", ["tanh of the command", "tanh of the state", "saturation"])
def test_also_where_the_command_enters_nonlinearly(way):
    """The three cases are those of an issue. The limit of the saturation is reached and left at jumps, so it has no corner in
    between."""
    square = BREAKING["square"][0]
    if way == "tanh of the command":
        given, command = problem(Tanh(square)), lambda t: np.tanh(square(t))
        expected = exactly(given, command, EDGES)
    elif way == "tanh of the state":
        given = Problem(
            plant=Plant(A_m=A_M, b=B, theta=[0.8, 0.5], x0=X0, regressor=Terms(terms=("tanh(x1)", "x1*x2"))),
            reference_model=ReferenceModel(k_0=K_0),
            reference=square,
        )
        expected = exactly(given, square, EDGES, regressor=lambda x: np.array([np.tanh(x[0]), x[0] * x[1]]))
    else:
        given = problem(square, input=PlantInput(saturation=(-2.0, 2.0)))
        expected = exactly(given, square, EDGES, level=2.0)
    order, errors = observed(given, expected)
    assert order == pytest.approx(4, abs=0.2)
    assert errors[0] < 1e-6  # 3e-3 without the split


def test_the_issue_s_square_wave():
    """The errors used to be of order h, 1.3e-2 and more at the coarsest step. Now they are of order h^4 down to roundings."""
    given = problem(BREAKING["square"][0])
    _, errors = observed(given, exactly(given, *BREAKING["square"]), steps=(0.02, 0.004, 0.0008))
    assert errors[0] < 1e-7
    assert errors[1] < 2e-10
    assert errors[2] < 1e-12


class Without:
    """A command that does not state its breaks."""

    def __init__(self, signal):
        self.signal, self.before = signal, signal.before

    def __call__(self, t):
        return self.signal(t)


@pytest.mark.parametrize("dt", [0.01, 0.0025])
def test_on_the_grid_not_a_bit_changes(dt):
    """The jumps are at multiples of 0.71 s and at the data's corners. A run to which they are known equals one to which they are
    not."""
    corners = Recorded(times=[0.12, 0.37, 0.77, 1.3], values=[1.0, -2.0, 3.0, 0.5])
    for signal in (Square(2.0, np.pi / 0.2), Step(2.0, start=0.71), Steps((0.3, 0.7), (1.0, 2.0)), corners):
        runs = [
            simulate(problem(s), [Mrac(gamma=GAMMA)], Simulation(t_end=2.13, dt=dt))["MRAC"] for s in (signal, Without(signal))
        ]
        np.testing.assert_array_equal(runs[0].states, runs[1].states)
        assert runs[0].figures == runs[1].figures


@pytest.mark.parametrize("t_end", [0.3, 2.4, 60.0, 1e4])
def test_what_is_typed_in_decimal_lies_on_the_grid(t_end):
    dt = 0.1
    simulation = Simulation(t_end=t_end, dt=dt)
    for k in (1, 2, 7, 13, 99):
        start = round(k * dt, 10)
        for signal in (Step(1.0, start=start), Square(1.0, np.pi / start), Recorded([0.0, start, 2 * start], [0.0, 1.0, 0.0])):
            assert not can_be_split((signal,), simulation)
            assert can_be_split((replace_start(signal, start + 1e-6),), simulation) == (start + 1e-6 < t_end)


def replace_start(signal, start):
    if isinstance(signal, Step):
        return Step(1.0, start=start)
    return Square(1.0, np.pi / start) if isinstance(signal, Square) else Recorded([0.0, start, 2 * start], [0.0, 1.0, 0.0])


def test_smooth_signals_have_no_breaks():
    smooth = Clock(), Constant(1.0), Sine(1.0, 2.0), Sines((1.0,), (2.0,)), Chirp(1.0, 2.0, 2.0, 0.33), Recorded([0, 1], [1, 1])
    assert not can_be_split(smooth, Simulation(t_end=3.0, dt=0.1))
    assert not isinstance(Sine(1.0, 2.0), BreakingSignal)


@pytest.mark.parametrize("kind", BREAKING)
def test_the_breaks_do_not_depend_on_where_one_looks(kind):
    """Computed at once or step by step, the result is identical, so a run can be resumed exactly."""
    signal, by_hand = BREAKING[kind]
    simulation = Simulation(t_end=3.0, dt=0.01)
    whole = breaks_inside((signal,), simulation, 0, 300)
    expected = np.array([t for t in by_hand if 0 < t < 3.0 and abs(t / 0.01 - round(t / 0.01)) > 1e-9])
    np.testing.assert_allclose(whole, expected, rtol=1e-14)
    np.testing.assert_array_equal(whole, np.concatenate([breaks_inside((signal,), simulation, k, k + 1) for k in range(300)]))


def test_the_pieces_of_the_table():
    """A ramp of data and a step are both within the second step of 0.1 s. The table has the values at the start, the middle and
    the end of each piece."""
    signals = (Step(1.0, start=0.15), Recorded([0.0, 0.13, 1.0], [0.0, 1.3, 1.3]))
    simulation = Simulation(t_end=1.0, dt=0.1)
    table = signal_table(signals, simulation, 0, 3, in_pieces=True)
    expected = [
        [0, 0.0, 0, 0.5, 0, 1.0, 1.0, 1, 1],
        [0, 1.0, 0, 1.15, 0, 1.3, 0.3, 1, 0],
        [0, 1.3, 0, 1.3, 0, 1.3, 0.2, 0, 0],
        [1, 1.3, 1, 1.3, 1, 1.3, 0.5, 0, 1],
        [1, 1.3, 1, 1.3, 1, 1.3, 1.0, 1, 1],
    ]
    np.testing.assert_allclose(table, expected, atol=1e-14)


def test_a_signal_that_breaks_more_often_than_anything_resolves():
    """With such a signal no step is split, the memory is not filled, and the run says so."""
    for frequency in (1e6, 1e15):
        run = simulate(problem(Square(1.0, frequency)), [Mrac(gamma=GAMMA)], Simulation(t_end=1.0, dt=0.01))["MRAC"]
        assert run.lost is not None
        assert "100 times or more in a step" in run.numerics


# --- metrics, ensembles, samples, noise, resumption ---

SQUARE = BREAKING["square"][0]


def test_figures_of_steps_in_pieces():
    """rms weights all steps equally. Extrema include the instants of the breaks, because u is largest right after a jump. The
    reference is DOP853."""
    given, controller = problem(SQUARE), Mrac(gamma=GAMMA, theta_hat0=[3.0, 0.0])
    simulations = [Simulation(t_end=T_END, dt=1 / 96, record_points=points) for points in (3, 192)]
    run, every = (simulate(given, [controller], simulation)["MRAC"] for simulation in simulations)
    assert len(every.t) == 193
    np.testing.assert_allclose(run.figures["rms_e"], np.sqrt((every.e**2).mean(axis=0)), rtol=1e-12)
    after = []
    for edge, level in zip(EDGES[:2], (-2.0, 2.0), strict=True):
        x, theta_hat = np.split(exactly_until(given, edge, controller.theta_hat0), (2, 4))[::2]
        after.append(float(-theta_hat @ x + K_0 * level))
    assert np.abs(after).max() > np.abs(every.u).max() + 1e-3  # between the instants of the grid
    assert run.figures["max_abs_u"] == pytest.approx(np.abs(after).max(), rel=1e-6)
    finer = simulate(given, [controller], Simulation(t_end=T_END, dt=1 / 9600))["MRAC"].figures
    # a path is a sum over steps: at a reversal of an estimate it misses twice the part within a step, of order h^2
    np.testing.assert_allclose(run.figures["theta_hat_variation_rate"], finer["theta_hat_variation_rate"], rtol=2e-3)


def exactly_until(given: Problem, stop: float, estimate) -> np.ndarray:
    P, y = given.known.P, np.concatenate([X0, X0, estimate])
    for start, end in pairwise([0.0, *(t for t in EDGES if t < stop - 1e-9), stop]):
        r = float(SQUARE(np.array((start + end) / 2)))

        def slope(_, y, r=r):
            x, x_m, theta_hat = y[:2], y[2:4], y[4:]
            x_dot = A_M @ x + B * (THETA @ x - theta_hat @ x + K_0 * r)
            return np.concatenate([x_dot, A_M @ x_m + B * K_0 * r, GAMMA * ((x - x_m) @ P @ B) * x])

        y = solve_ivp(slope, (start, end), y, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return y


def test_a_divergence_inside_of_a_step_in_pieces_has_the_step_s_time():
    """x' = x^2 diverges soon after the jump of the command. The time is the same to a step whether the run is recorded or not."""
    plant = Plant(A_m=[[-1.0]], b=[1.0], theta=[1.0], x0=[0.1], regressor=Terms(terms=("x1**2",)))
    given = Problem(plant=plant, reference=Step(200.0, start=0.50123))
    times = []
    for points in (3, 50, 1000):
        run = simulate(given, [Mrac(gamma=1e-30)], Simulation(t_end=1.0, dt=0.001, record_points=points))["MRAC"]
        times.append(run.diverged_at)
    assert times[0] is not None
    assert 0.5 < times[0] < 1
    assert times == [times[0]] * 3


def test_ensembles_are_single_runs():
    """No bit depends on lanes or threads. The tolerance is 1e-9, as for any ensemble compared with a run whose numbers are
    compiled in."""
    rng = np.random.default_rng(3)
    simulation = Simulation(t_end=T_END, dt=1 / 96)
    members = [(problem(SQUARE), Mrac(gamma=float(rng.uniform(0.1, 2)))) for _ in range(11)]
    results = [simulate_ensemble(members, simulation, lanes=lanes, threads=n).metrics for lanes, n in ((1, 1), (4, 2), (8, 1))]
    results.append(simulate_ensemble(members, simulation, quarters=True).metrics)
    for name in results[0].__dataclass_fields__:
        for other in results[1:3]:
            np.testing.assert_array_equal(getattr(results[0], name), getattr(other, name))
    np.testing.assert_allclose(results[3].max_abs_e, results[0].max_abs_e, rtol=1e-13)
    for i in (0, 10):
        alone = simulate(members[i][0], [members[i][1]], simulation)["MRAC"]
        np.testing.assert_allclose(results[0].rms_e[i], alone.figures["rms_e"], rtol=1e-9)


@pytest.mark.parametrize("discretization", ["euler", "midpoint"])
def test_samples_and_noise_keep_their_rhythm(discretization):
    """There is a sample every 0.05 s and new noise every 0.01 s, whatever is split in between. 25 times finer steps agree."""
    controller = Sampled(controller=Mrac(gamma=GAMMA, name="c"), sample_time=0.05, discretization=discretization)
    given = replace(problem(Square(2.0, np.pi / 0.7123)), sensor=Sensor(noise=Noise(std=0.05, sample_time=0.01, seed=5)))
    runs = [simulate(given, [controller], Simulation(t_end=T_END, dt=h))["c"] for h in (0.01, 0.0004)]
    ends = [np.concatenate([run.x[-1], run.x_m[-1], run.theta_hat[-1]]) for run in runs]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-8)  # h^4; one more value of noise or one more sample changes it by 1e-3
    assert runs[0].figures["theta_hat_variation_rate"] == pytest.approx(runs[1].figures["theta_hat_variation_rate"], rel=1e-6)


@pytest.mark.parametrize("part", ["plain", "noise", "sampled"])
def test_the_label_resumes_what_ran(part):
    """The time in the label does not depend on the record, because parts of the run are simulated again and split at the same
    instants."""
    command = Steps((0.3001, 0.6004, 1.0007, 1.0202, 2.0003), (0.2, 0.1, 30.0, 40.0, 20.0))
    box = ParameterBox(lower=[-5.0, -5.0], upper=[5.0, 5.0])
    given, controller = replace(problem(command), uncertainty=box), L1Adaptive(gamma=1e6, filter=input_filter(0.02))
    if part == "noise":
        given = replace(given, sensor=Sensor(noise=Noise(std=1e-3, sample_time=2e-3, seed=3)))
    if part == "sampled":
        controller = Sampled(controller=Mrac(gamma=200.0), sample_time=2e-3, discretization="euler")
    times, ends = [], []
    for points in (7, 100, 3000):
        (run,) = simulate(given, [controller], Simulation(t_end=3.0, dt=1e-3, record_points=points)).values()
        times.append(run.stiffness.unstable_from)
        ends.append(run.states[-1])
        assert run.diverged_at is None
    assert times[0] is not None
    assert times[0] > 1.02  # after four of the pieces
    assert times == [times[0]] * 3
    np.testing.assert_array_equal(ends[0], ends[2])


# --- loss of order ---


@pytest.mark.parametrize(
    ("solver", "signal", "said"),
    [
        (
            RK4,
            SQUARE,
            "the command or a disturbance jumps inside 1 of the 100 steps of a delayed loop, which cannot be split: first order",
        ),
        (HEUN, SQUARE, "first order there"),
        (EULER, SQUARE, None),
        (RK4, DATA, "has a corner inside 4 of the 100 steps of a delayed loop, which cannot be split: second order there"),
        (HEUN, DATA, None),
        (
            RK4,
            Sine(1.0, 2.0),
            "the delayed control has corners, at t = 0 and one delay after each jump, which are interpolated: second order there",
        ),
        (
            RK4,
            Step(1.0, start=0.7),
            "the delayed control has corners, at t = 0 and one delay after each jump, which are interpolated: second order there",
        ),
    ],
)
def test_a_delayed_loop_says_what_it_loses(solver, signal, said):
    given, simulation = problem(signal, input=PlantInput(delay=0.1)), Simulation(t_end=T_END, dt=0.02, solver=solver)
    run = simulate(given, [Mrac(gamma=GAMMA)], simulation)["MRAC"]
    ensemble = simulate_ensemble([(given, Mrac(gamma=GAMMA))] * 2, simulation)
    assert run.lost == ensemble.lost
    if said is None:
        assert run.lost is None
        assert "lost_order" not in run_block(run)
    else:
        assert said in run.numerics
        assert said in json.loads(json.dumps(run_block(run)))["lost_order"]["sentence"]


def test_the_loss_that_is_said_is_the_loss():
    """In the open loop with a delay of whole steps, a jump's error is of first order in the step, and a corner's of second
    order."""
    for signal, order in ((Step(2.0, start=0.50437), 1), (Recorded([0.0, 0.50437, 2.0], [0.0, 0.0, 2.0]), 2)):
        given = problem(signal, input=PlantInput(delay=0.1))
        fine = simulate(given, [Mrac(gamma=1e-30)], Simulation(t_end=T_END, dt=0.1 / 4096))["MRAC"].x[-1]
        errors = []
        for h in 0.1 / 2.0 ** np.arange(1, 9):
            run = simulate(given, [Mrac(gamma=1e-30)], Simulation(t_end=T_END, dt=h))["MRAC"]
            assert run.lost is not None
            assert run.lost.order == order
            errors.append(np.abs(run.x[-1] - fine).max())
        slope = np.polyfit(np.arange(8), -np.log2(errors), 1)[0]
        assert slope == pytest.approx(order, abs=0.4)  # the fraction of a step at which the break lies differs from step to step


@pytest.mark.parametrize("delay", [0.04, 1 / 30.7])
@pytest.mark.parametrize("sampled", [False, True])
def test_bends_of_the_control_behind_a_delay(delay, sampled):
    """With a smooth command u has a bend at the end of its history, at t = 0, which reaches the plant one delay later. A held u
    jumps."""
    controller = Mrac(gamma=2.0, name="c")
    controller = Sampled(controller=controller, sample_time=0.04, discretization="euler") if sampled else controller
    given = problem(Sine(2.0, 3.0), input=PlantInput(delay=delay))
    steps = 50 * 2 ** np.arange(1, 5)
    runs = [simulate(given, [controller], Simulation(t_end=T_END, dt=T_END / n))["c"] for n in (*steps, 12800)]
    ends = [np.concatenate([run.x[-1], run.theta_hat[-1]]) for run in runs]
    errors = [np.abs(end - ends[-1]).max() for end in ends[:-1]]
    slope = -np.polyfit(np.log2(steps), np.log2(errors), 1)[0]
    ensemble = simulate_ensemble([(given, controller)] * 2, Simulation(t_end=T_END, dt=T_END / steps[0]))
    assert ensemble.lost == runs[0].lost
    if not sampled:
        assert slope == pytest.approx(2, abs=0.3)
        assert runs[0].lost.order == 2
        assert runs[0].lost.bends
        assert "second order there" in json.loads(json.dumps(run_block(runs[0])))["lost_order"]["sentence"]
        return
    assert slope == pytest.approx(4, abs=0.3)
    assert runs[0].lost is None
    behind = problem(Sine(2.0, 3.0), input=PlantInput(delay=delay, actuator=TransferFunction([20.0], [1.0, 20.0])))
    assert simulate(behind, [controller], Simulation(t_end=T_END, dt=0.01))["c"].lost.bends  # of the actuator, at every sample


def test_of_millions_of_jumps_in_a_step_none_is_looked_at(monkeypatch):
    """Finding which of ten million jumps are on the grid took seconds for every controller of a case."""

    def evaluated(*_):
        raise AssertionError("the signal is evaluated")

    monkeypatch.setattr(Square, "before", evaluated)
    lost = lost_order((Square(amplitude=1.0, frequency=1e42),), Simulation(t_end=0.1, dt=1e-3), delayed=False)
    assert lost is not None and lost.order == 1


SMOOTH = Sine(1.0, 1.0)
MOTION = {
    "a rate limiter that never limits": (PlantInput(rate_limit=1000.0), None, 1, "it lags by one step: first order"),
    "a converter": (PlantInput(quantization=0.01), None, 1, "first order at best"),
    "a saturation": (PlantInput(saturation=[-0.2, 0.2]), None, 2, "saturation inside steps: second order"),
    "a dead zone": (PlantInput(), DeadZone(0.05), 2, "the dead zone's edge inside steps: second order"),
    "a saturation that is not reached": (PlantInput(saturation=[-50.0, 50.0]), None, 4, None),
}


@pytest.mark.parametrize("name", MOTION)
@pytest.mark.short(kept=lambda name: name in ("a converter", "a saturation that is not reached"))
def test_what_the_motion_costs_is_said(name):
    """The order is by regression over steps, compared with a run at a far finer step. The errors of a converter are as irregular
    as its crossings."""
    path, dead_zone, order, said = MOTION[name]
    given, controller = problem(SMOOTH, input=path), Mrac(gamma=GAMMA, name="c", dead_zone=dead_zone)
    steps = np.round(np.geomspace(40, 2500, 14))
    runs = [simulate(given, [controller], Simulation(t_end=T_END, dt=T_END / n))["c"] for n in (*steps, 200_000)]
    errors = [np.abs(run.states[-1] - runs[-1].states[-1]).max() for run in runs[:-1]]
    slope = -np.polyfit(np.log2(steps), np.log2(errors), 1)[0]
    assert slope == pytest.approx(order, abs=0.6 if order < 4 else 0.3)
    ensemble = simulate_ensemble([(given, controller)] * 2, Simulation(t_end=T_END, dt=T_END / 40))
    assert ensemble.lost == runs[0].lost
    if said is None:
        assert runs[0].lost is None
        return
    assert runs[0].lost.order == order and said in runs[0].numerics
    assert said in json.loads(json.dumps(run_block(runs[0])))["lost_order"]["sentence"]
    assert simulate(given, [controller], Simulation(t_end=T_END, dt=0.02, solver=EULER))["c"].lost is None


@pytest.mark.parametrize(("term", "order"), [("abs(x2)", 2), ("x1**2", 4)])
def test_what_a_corner_in_the_plant_costs_is_said(term, order):
    """The corner is in the plant, also with a sampled controller."""
    given, controller = problem(SMOOTH, regressor=Terms(terms=("x1", term))), Mrac(gamma=GAMMA, name="c")
    steps = np.round(np.geomspace(40, 2500, 14))
    runs = [simulate(given, [controller], Simulation(t_end=T_END, dt=T_END / n))["c"] for n in (*steps, 200_000)]
    errors = [np.abs(run.states[-1] - runs[-1].states[-1]).max() for run in runs[:-1]]
    assert -np.polyfit(np.log2(steps), np.log2(errors), 1)[0] == pytest.approx(order, abs=0.6 if order < 4 else 0.3)
    held = Sampled(controller=controller, sample_time=0.04, discretization="euler")
    sampled = simulate(given, [held], Simulation(t_end=T_END, dt=0.02))["c"]
    for run in (runs[0], sampled):
        assert (run.lost is None) == (order == 4)
        assert run.lost is None or (run.lost.order == 2 and "zero of an abs" in run.lost.sentence)


@pytest.mark.parametrize(
    "known", [ParameterBox(lower=[-5.0, -5.0], upper=[5.0, 5.0]), ParameterBall(center=[0.0, 0.0], radius=5.0)]
)
def test_what_a_projection_costs_is_said_where_it_acts(known):
    """Without an active projection RK4 keeps its order. If the estimates' rate jumps at the boundary, the order is one."""
    narrow = ParameterBall(known.center, 0.05) if isinstance(known, ParameterBall) else ParameterBox([-0.05] * 2, [0.05] * 2)
    simulation = Simulation(t_end=T_END, dt=T_END / 200)
    for bounds, acts in ((known, False), (narrow, True)):
        given, controller = replace(problem(SMOOTH), uncertainty=bounds), Mrac(gamma=GAMMA, name="c", projection=True)
        run = simulate(given, [controller], simulation)["c"]
        assert (run.lost is not None) == acts
        assert not acts or (run.lost.order == 1 and "known set's boundary" in run.lost.sentence)
        held = Sampled(controller=controller, sample_time=0.04, discretization="euler")
        assert simulate(given, [held], simulation)["c"].lost is None
        assert simulate_ensemble([(given, controller)] * 2, simulation).lost is not None  # no estimates are recorded there


PARTS = {
    "a leakage that switches": (
        Mrac(gamma=GAMMA, name="c", leakage=SwitchingSigma(sigma=1.0, M_0=0.1)),
        2,
        "leakage's switching",
    ),
    "the epsilon-modification": (Mrac(gamma=GAMMA, name="c", leakage=EpsilonModification(nu=1.0)), 2, "zero of the error"),
    "np.sign": (wrong(control=lambda self, s, x, x_m, r: r - 0.1 * np.sign(x[0])), 1, "np.sign"),
    "np.abs": (wrong(control=lambda self, s, x, x_m, r: r - 0.1 * np.abs(x[0])), 2, "np.abs"),
    "np.tanh": (wrong(control=lambda self, s, x, x_m, r: r - 0.1 * np.tanh(x[0])), None, ""),
}


@pytest.mark.parametrize("name", PARTS)
def test_what_a_corner_or_a_jump_of_the_law_costs_is_said(name):
    """A law of the package declares its corners and jumps. User-defined equations are examined."""
    controller, order, said = PARTS[name]
    given, simulation = problem(SMOOTH), Simulation(t_end=T_END, dt=0.02)
    lost = next(iter(simulate(given, [controller], simulation).values())).lost
    assert (lost is None) == (order is None)
    assert lost is None or (lost.order == order and said in lost.sentence)
    bounded = LeastSquaresBounded(covariance0=5.0, forgetting=0.5, covariance_bound=8.0)
    robust = simulate(given, [RobustMrac(law=bounded, tau=0.05)], simulation)["Robust MRAC"].lost
    assert robust is not None and robust.order == 1 and "bound of the covariance" in robust.sentence


def test_a_held_control_is_saturated_without_loss():
    held = Sampled(controller=Mrac(gamma=GAMMA, name="c", dead_zone=DeadZone(0.05)), sample_time=0.04, discretization="euler")
    given = problem(SMOOTH, input=PlantInput(saturation=[-0.2, 0.2], quantization=0.01))
    assert simulate(given, [held], Simulation(t_end=T_END, dt=0.02))["c"].lost is None
