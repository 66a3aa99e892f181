"""Claims on the estimates: what is learnt, how fast, and what a high gain does to it."""

from __future__ import annotations

import numpy as np

from barbalat.adaptation.laws import Gradient
from barbalat.claims import section_v
from barbalat.claims.claim import Claim, verdict
from barbalat.claims.section_v import Runs
from barbalat.claims.variants import numbers, variant
from barbalat.controllers import Mrac, NormalizedMrac
from barbalat.protocols import Controller
from barbalat.run.result import Result
from barbalat.run.simulate import simulate
from barbalat.signals import Sines
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


def loss_of_learning(runs: Runs) -> Claim:
    """The estimates of L1-AC at both steps beside the robust MRAC's, on the same exciting signals."""
    coarse, fine, robust = runs.coarse["L1"], runs.fine["L1, gamma 1e4"], runs.coarse["Robust MRAC"]
    distances = [
        float(np.linalg.norm(r.theta_hat - r.problem.plant.theta, axis=1)[r.t > 45].min()) for r in (coarse, fine, robust)
    ]
    spread = [float(np.linalg.norm(r.theta_hat - r.problem.plant.theta, axis=1)[r.t > 45].max()) for r in (coarse, fine, robust)]
    return Claim(
        "loss-of-learning", "Section V, Figure 3", "Numerical instability makes L1-AC lose learning although the signals are exciting",
        verdict(holds=spread[0] > 5 and spread[2] < 0.01, conditional=spread[1] > 0.5),
        f"|theta_hat - theta*| over the last 15 s: {distances[0]:.2g} to {spread[0]:.2g} at h = 1e-4 s, {distances[1]:.2g} to {spread[1]:.2g} at "
        f"h = 1e-5 s, {distances[2]:.2g} to {spread[2]:.2g} for the robust MRAC: the gain alone keeps the estimates from converging in 60 s, "
        "oscillation or not",
        "recorded instants of Figures 2, 3, 4",
    )  # fmt: skip


def exponential() -> Claim:
    """Least squares, gradient and the unnormalised law under two sines."""
    given = variant(reference=Sines((10.0, 10.0), (0.5, 1.7)))
    controllers: list[Controller] = [
        section_v.robust_mrac("least squares"),
        NormalizedMrac(law=Gradient(gamma=10.0), c_0=section_v.C_0, name="normalised gradient"),
        Mrac(gamma=1.0, name="MRAC"),
    ]
    runs = simulate(given, controllers, Simulation(t_end=480.0, dt=1e-3))
    distance = {name: _distance(run) for name, run in runs.items()}
    t = next(iter(runs.values())).t
    at = np.searchsorted(t, [60.0, 120.0, 240.0, 479.0])
    power = np.polyfit(np.log(t[at]), np.log(distance["least squares"][at]), 1)[0]
    rate = -np.polyfit(t[at][1:], np.log(distance["normalised gradient"][at][1:]), 1)[0]
    is_algebraic = abs(power + 1) < 0.15
    return Claim(
        "exponential-convergence", "after Theorem 2", "With enough excitation the estimates converge exponentially",
        verdict(holds=not is_algebraic and rate > 0),
        f"|theta_hat - theta*| at 60, 120, 240, 479 s: pure least squares (15) {numbers(distance['least squares'][at])}, that is t^{power:.2f}: "
        f"not exponential; normalised gradient {numbers(distance['normalised gradient'][at])}, exponential with {rate:.3f} per s; MRAC with "
        f"Gamma = 1 {numbers(distance['MRAC'][at])}",
        "Section V with r = 10 sin 0.5t + 10 sin 1.7t, RK4, h = 1e-3 s, 480 s",
    )  # fmt: skip


def _distance(result: Result) -> Array:
    return np.linalg.norm(result.theta_hat - result.problem.plant.theta, axis=1)
