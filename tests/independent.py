"""Independent methods for the tests: stepping that keeps every sample, and a high-order adaptive integration.

Nothing here uses the package's tableaux, tables, blocks, accumulators or machine code.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat.adaptation.laws import Gradient, LeastSquares
from barbalat.adaptation.lyapunov import LyapunovLaw
from barbalat.adaptation.modifications import FixedSigma
from barbalat.controllers import (
    Adrc,
    BaselineAlone,
    DirectMrac,
    KnownParameters,
    L1Adaptive,
    L1PiecewiseConstant,
    LinearFeedback,
    MitRule,
    Mrac,
    MracClosedLoop,
    NetworkMrac,
    NormalizedMrac,
    RobustMrac,
)
from barbalat.controllers.output import L1Output, L1OutputPiecewiseConstant, LinearOutput, MracOutput
from barbalat.controllers.output.l1 import linear_equivalent
from barbalat.controllers.piecewise_predictor import AsFlown
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import jacobian_function
from barbalat.loop.packing import column, symbols
from barbalat.validate import InputError

EPS = np.finfo(float).eps


def refusal(make: Callable[[], object]) -> str:
    """The message with which ``make`` is rejected. It is one sentence on one line."""
    with pytest.raises(InputError) as caught:
        make()
    message = str(caught.value)
    assert message and "\n" not in message
    assert len(message) < 500
    return message


def as_toml(value: object) -> str:
    """A value as TOML text, valid or not."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + "".join(f"\\U{ord(c):08X}" if not 0xD800 <= ord(c) < 0xE000 else "?" for c in value) + '"'
    if isinstance(value, list):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{as_toml(key)} = {as_toml(entry)}" for key, entry in value.items()) + "}"
    return repr(value)


@dataclass
class Samples:
    """Every sample of a run, 0...steps: states (steps + 1, size); e, theta_hat (steps + 1, n); u (steps + 1,)."""

    states: np.ndarray
    e: np.ndarray
    u: np.ndarray
    theta_hat: np.ndarray


def brute_force(loop: ClosedLoop, signals, solver: str, dt: float, steps: int) -> Samples:
    """A run by the textbook formulas of each method. A step ends with the signals' limit from the left."""

    def at(t: float) -> np.ndarray:
        return np.array([float(signal(np.array(t))) for signal in signals])

    def left(t: float) -> np.ndarray:
        return np.array([float(signal.before(np.array(t))) for signal in signals])

    f, limit = loop.derivative, loop.limit
    every = 0 if loop.sample_time is None else round(loop.sample_time / dt)
    y = loop.sample(loop.initial(), at(0.0)) if every else loop.initial()
    states = [y]
    for k in range(steps):
        start, middle, end = at(k * dt), at((k + 0.5) * dt), left((k + 1) * dt)
        k_1 = f(y, start)
        if solver == "euler":
            y = limit(y + dt * k_1)
        elif solver == "heun":
            k_2 = f(limit(y + dt * k_1), end)
            y = limit(y + dt / 2 * (k_1 + k_2))
        elif solver == "rk4":
            k_2 = f(limit(y + dt / 2 * k_1), middle)
            k_3 = f(limit(y + dt / 2 * k_2), middle)
            k_4 = f(limit(y + dt * k_3), end)
            y = limit(y + dt / 6 * (k_1 + 2 * k_2 + 2 * k_3 + k_4))
        else:
            pytest.fail(f"no brute-force formulas for the solver {solver}: add them here")
        if every and (k + 1) % every == 0:
            y = loop.sample(y, at((k + 1) * dt))
        states.append(y)
    parts = [loop.unpack(state) for state in states]
    measured = [(loop.plant.output(p.x), loop.model.output(p.x_m)) for p in parts]
    u = [
        p.held.u if every else loop.equations.control(p.controller, *y, at(k * dt)[0])
        for k, (p, y) in enumerate(zip(parts, measured, strict=True))
    ]
    return Samples(
        states=np.array(states),
        e=np.array([np.atleast_1d(y - y_m) for y, y_m in measured]),
        u=np.array(u),
        theta_hat=np.array([loop.theta_hat(p.controller) for p in parts]),
    )


def symbols_against_numbers(loop: ClosedLoop, size: float) -> None:
    """Compare the derivative traced and evaluated by CasADi with the same equations on NumPy arrays at random states.

    The tolerance 1e-10 is for the same sums in a different order, with a few dozen roundings of terms up to 1e4.
    """
    import casadi as ca

    state_column, state = symbols("state", loop.size)
    signal_column, signal = symbols("signals", 1)
    evaluated = [loop.derivative, lambda state, _: loop.limit(state), lambda *given: np.concatenate(loop.outputs(*given))]
    evaluated += [loop.sample] if loop.sampled else []
    outputs = [f(state, signal) for f in evaluated]
    traced = ca.Function("f", [state_column, signal_column], [column(value) for value in outputs])
    random = np.random.default_rng(5)
    for _ in range(20):
        y, r = size * random.normal(size=loop.size), random.normal(size=1)
        numbers = [f(y, r) for f in evaluated]
        for symbolic, numeric in zip(traced(y, r), numbers, strict=True):
            np.testing.assert_allclose(np.asarray(symbolic)[:, 0], numeric, rtol=1e-10, atol=1e-10)


def jacobian_against_differences(loop: ClosedLoop) -> None:
    """Compare the Jacobian with central differences of the right-hand side, whose errors are h^2 = 1e-10 times third derivatives
    and eps/h = 1e-11 times values."""
    random = np.random.default_rng(2)
    y, signals = loop.initial() + 0.1 * random.uniform(0.5, 1.0, loop.size), np.array([0.7])
    columns = []
    for i in range(loop.size):
        d = 1e-5 * np.eye(loop.size)[i]
        columns.append((loop.derivative(y + d, signals) - loop.derivative(y - d, signals)) / 2e-5)
    exact = np.asarray(jacobian_function(loop)(y, signals))
    np.testing.assert_allclose(exact, np.array(columns).T, rtol=1e-5, atol=1e-5 * max(1, np.abs(exact).max()))


def integrate(derivative, y0, t_end: float, t_eval=None, rtol: float = 1e-12, atol: float = 1e-12) -> np.ndarray:
    """States (size, instants) by the eighth-order method of Dormand and Prince with error control."""
    solution = solve_ivp(derivative, (0, t_end), y0, method="DOP853", rtol=rtol, atol=atol, t_eval=t_eval)
    assert solution.success
    return solution.y


def example_controllers(n: int) -> dict[str, tuple]:
    """For each registered scheme, settings with which the loop of order n is smooth and tracks; see conftest."""
    gamma = {1: 10.0, 2: 2.0, 3: 20.0}[n]
    gentle = {1: 1.0, 2: 2.0, 3: 20.0}[n]  # for the MIT rule, which bursts at higher gains
    covariance0 = {1: 50.0, 2: 50.0, 3: 500.0}[n]
    return {
        "mrac": (Mrac(gamma=gamma),),
        "mrac-closed-loop": (MracClosedLoop(gamma=gamma, model_feedback=-0.5 * np.eye(n)),),
        "mrac-direct": (DirectMrac(gamma=gamma), DirectMrac(gamma=gamma * np.ones(n), gamma_r=5.0, k_r0=0.0)),
        "mrac-network": (NetworkMrac(gamma=gamma, leakage=FixedSigma(1e-3 if n < 3 else 1e-4), neurons=3),),
        "mit-rule": (MitRule(gamma=gentle), MitRule(gamma=gentle, normalization=1.0, output=np.ones(n))),
        "l1": (L1Adaptive(gamma=gamma, filter=input_filter(0.01)),),
        "l1-piecewise": (
            L1PiecewiseConstant(sample_time=2.0**-6, filter=input_filter(0.02)),
            L1PiecewiseConstant(sample_time=2.0**-6, filter=input_filter(0.05), as_flown=AsFlown(predictor_poles=-2.0)),
        ),
        "mrac-normalized": (NormalizedMrac(law=Gradient(gamma=200.0)), NormalizedMrac(law=LeastSquares(covariance0=covariance0))),
        "robust-mrac": (
            RobustMrac(tau=0.2, law=LeastSquares(covariance0=covariance0)),
            RobustMrac(tau=0.2, law=Gradient(gamma=200.0)),
        ),
        "linear": (
            LinearFeedback(controller=TransferFunction([50.0, 40.0], [1.0, 0.0])),
            LinearFeedback(controller=TransferFunction([50.0], [1.0, 10.0]), output=np.arange(1.0, n + 1), nominal=np.ones(n)),
        ),
        "adrc": (
            Adrc(bandwidth=20.0),
            Adrc(bandwidth=30.0, output=np.eye(n)[0], nominal=0.5 * np.ones(n)),
        ),
        "baseline": (BaselineAlone(), BaselineAlone(nominal={1: [1.2], 2: [0.8, -0.4], 3: [0.8, -0.8, 0.4]}[n])),
        "known-parameters": (KnownParameters(theta={1: [1.5], 2: [1.0, -0.5], 3: [1.0, -1.0, 0.5]}[n]),),
    }


def example_output_controllers(n: int) -> dict[str, tuple]:
    """For each registered output scheme, settings with which the output loop of order n is smooth and tracks; see conftest."""
    box = {"lower": np.append(np.full(2 * n - 1, -40.0), 0.05), "upper": np.append(np.full(2 * n - 1, 40.0), 5.0)}
    designed = {"order": n, "relative_degree": 1, "sign": 1}
    same = linear_equivalent(L1Output(m=2.0, gamma=300.0, filter=TransferFunction([20.0], [1.0, 20.0])))
    return {
        "mrac-output": (
            MracOutput(law=LyapunovLaw(gamma=5.0), **designed),
            MracOutput(law=Gradient(gamma=5.0), tau=0.2, **box, **designed),
            MracOutput(law=LeastSquares(covariance0=5.0), tau=0.2, c_0_min=0.05, **designed),
        ),
        "l1-output": (
            L1Output(m=2.0, gamma=300.0, filter=TransferFunction([20.0], [1.0, 20.0]), sigma_bound=30.0),
            L1Output(m=2.0, gamma=300.0, filter=TransferFunction([400.0], [1.0, 28.0, 400.0])),
        ),
        "l1-output-piecewise": (
            L1OutputPiecewiseConstant(sample_time=2.0**-6, filter=TransferFunction([20.0], [1.0, 20.0])),
            L1OutputPiecewiseConstant(sample_time=2.0**-5, filter=TransferFunction([400.0], [1.0, 28.0, 400.0])),
        ),
        "linear": (
            LinearOutput(loop=TransferFunction([20.0, 20.0], [1.0, 0.0])),
            LinearOutput(loop=same.feedback, feedforward=same.feedforward),
        ),
    }
