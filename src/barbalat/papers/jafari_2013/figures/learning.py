"""Claims on the estimates: their convergence, its rate, and the effect of a high gain."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from barbalat.adaptation.laws import Gradient
from barbalat.controllers import Mrac, NormalizedMrac
from barbalat.papers.claim import Claim, Listing, Measurement, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import Runs, at_instants, variant
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.papers.jafari_2013.statements import MENDED
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.run.engine.simulate import simulate
from barbalat.run.results.result import Result
from barbalat.signals import Sines
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


def loss_of_learning(runs: Runs) -> Claim:
    """Compare the estimates of L1-AC at both steps with those of the robust MRAC, on the same exciting signals."""
    coarse, fine, robust = runs.coarse["L1"], runs.fine["L1, gamma 1e4"], runs.coarse["Robust MRAC"]
    distances = [float(_distance(r)[r.t > 45].min()) for r in (coarse, fine, robust)]
    spread = [float(_distance(r)[r.t > 45].max()) for r in (coarse, fine, robust)]
    sentence, nearest = SENTENCES["loss-of-learning"], float(_distance(fine).min())
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(spread[0] > 5 and spread[2] < 0.01, f"at h = 1e-4 s the estimates are up to {spread[0]:.2g} away from "
            f"theta, and those of the robust MRAC up to {spread[2]:.2g}"),
            sentence.reads(nearest < 0.5, f"at h = 1e-5 s, without numerical instability, the estimates stay at least "
            f"{nearest:.2g} away during all 60 s", 1),
        ),
        shows=f"At Figure 3's step the estimates are up to {spread[0]:.2g} away from theta in the last 15 s; at a step without "
        f"instability they still stay at least {distances[1]:.2g} away.",
        measured=        f"|theta_hat - theta*| over the last 15 s: {distances[0]:.2g} to {spread[0]:.2g} at h = 1e-4 s, "
        f"{distances[1]:.2g} to {spread[1]:.2g} at h = 1e-5 s, and {distances[2]:.2g} to {spread[2]:.2g} for the robust MRAC. "
        "With this gain the estimates do not converge in 60 s, with or without oscillation",
        how=f"recorded instants of Figures 2, 3, 4; Figure 2 has {MENDED}",
        listings=(_over_time({"L1-AC, h = 1e-4 s": coarse, "L1-AC, h = 1e-5 s": fine, "robust MRAC, h = 1e-4 s": robust}),),
        would_change="estimates that converge in 60 s with a step that resolves the gain, or at Figure 3's step",
    )  # fmt: skip


def _over_time(runs: Mapping[str, Result]) -> Listing:
    columns = {name: _distance(run)[at_instants(run.t, FIGURES_INSTANTS)] for name, run in runs.items()}
    return table("The distance |theta_hat - theta*| of the estimates from the true values", {"t [s]": FIGURES_INSTANTS} | columns)


FIGURES_INSTANTS = (0.0, 3.0, 15.0, 30.0, 45.0, 60.0)
"""Instants [s] recorded for Figures 2, 3 and 4, which end at 60 s."""
TOLD_INSTANTS = (60.0, 120.0, 240.0, 479.04)
"""Recorded instants [s]. Each is about twice the previous one, and the last is just before the end."""


def exponential() -> Claim:
    """Compare least squares, the gradient law and the unnormalised law under a command of two sines."""
    given = variant(reference=Sines((10.0, 10.0), (0.5, 1.7)))
    controllers: list[Controller] = [
        section_v.robust_mrac("least squares"),
        NormalizedMrac(law=Gradient(gamma=10.0), c_0=section_v.C_0, name="normalised gradient"),
        Mrac(gamma=1.0, name="MRAC"),
    ]
    runs = simulate(given, controllers, Simulation(t_end=480.0, dt=1e-3))
    distance = {name: _distance(run) for name, run in runs.items()}
    t = next(iter(runs.values())).t
    at = at_instants(t, TOLD_INSTANTS)
    power = np.polyfit(np.log(t[at]), np.log(distance["least squares"][at]), 1)[0]
    rate = -np.polyfit(t[at][1:], np.log(distance["normalised gradient"][at][1:]), 1)[0]
    late = {name: -np.diff(np.log(values[at])) / np.diff(t[at]) for name, values in distance.items()}
    keeps = {name: bool(rates[-1] > KEPT_RATE * rates[-2] > 0) for name, rates in late.items()}
    sentence = SENTENCES["exponential-convergence"]
    readings = (
        sentence.reads(keeps["least squares"], f"|theta_hat - theta*| falls as t^{power:.2f}"),
        Reading(
            "with the normalised gradient law, whose gain does not vanish, in place of (15)",
            keeps["normalised gradient"],
            f"it converges exponentially, at {rate:.3f} per s",
            "beside",
        ),
    )
    return Claim(
        sentence=sentence,
        readings=readings,
        shows=f"The error of pure least squares (15) falls as t^{power:.2f} and that of the gradient law as exp(-{rate:.3f} t).",
        measured=        f"|theta_hat - theta*| with pure least squares (15) falls as t^{power:.2f}, which is not exponential. "
        f"With the normalised gradient law it falls exponentially, at {rate:.3f} per s. For MRAC with Gamma = 1 it is still "
        f"{distance['MRAC'][at][-1]:.3g} after {TOLD_INSTANTS[-1]:g} s",
        how=f"Section V with r = 10 sin 0.5t + 10 sin 1.7t, robust MRAC, {MENDED}, RK4, h = 1e-3 s, 480 s",
        listings=(_distances({name: values[at] for name, values in distance.items()}),),
        would_change="for (15): forgetting or resetting, which keep the covariance away from zero; for the gradient law: too "
        "little excitation",
    )  # fmt: skip


KEPT_RATE = 0.8
"""The fraction of the decay rate that must remain from one interval to the next, which is twice as long. An exponential decay
keeps all of its rate, an algebraic decay half."""


def _distances(at_instants: dict[str, Array]) -> Listing:
    columns = {"least squares (15)": "least squares", "normalised gradient": "normalised gradient", "MRAC, Gamma = 1": "MRAC"}
    return table(
        "The distance |theta_hat - theta*| of the estimates from the true values",
        {"t [s]": TOLD_INSTANTS} | {shown: at_instants[name] for shown, name in columns.items()},
    )


def _distance(result: Result) -> Array:
    assert isinstance(result.problem, Problem)
    return np.linalg.norm(result.theta_hat - result.problem.plant.theta, axis=1)


ROWS = (
    Measurement(
        loss_of_learning, 0.1, {"loss-of-learning": "numerical instability and learning"}, place=270, quick=True, judges_runs=True
    ),
    Measurement(exponential, 0.5, {"exponential-convergence": "exponential convergence of the estimates"}, place=280, quick=True),
)
