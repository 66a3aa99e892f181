"""A sampled law that no gain destabilises numerically, although the sentence says that no solver avoids the phenomenon; and the
delays that the law tolerates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from barbalat.controllers import Mrac, Sampled
from barbalat.papers.claim import Claim, Listing, Measurement, span, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import figures, variant
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.problem.actuation import PlantInput
from barbalat.protocols import Controller
from barbalat.run.engine.simulate import simulate
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, counted

GAINS = (1e2, 1e4, 1e6, 1e8)


def claim() -> Claim:
    """Measure the variation of the estimates for gains from 1e2 to 1e8, with midpoint and Euler steps, with and without a
    filter."""
    smooth = {scheme: _rates(scheme, "midpoint") for scheme in ("MRAC", "L1")}
    rough = _rates("MRAC", "euler")
    spread = max(float((rates.max(axis=0) / rates.min(axis=0)).max()) for rates in smooth.values())
    sentence = SENTENCES["sampled-midpoint"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(spread < 2, f"the largest variation is {spread:.3f} times the smallest"),
            Reading(
                "the same holds for MRAC with explicit Euler steps",
                bool(rough.max() < 2 * rough.min()),
                f"{span(rough[:, 0])} per s",
                "beside",
            ),
        ),
        shows=f"Over Gamma = {GAINS[0]:g} to {GAINS[-1]:g} the variation of the estimates changes by a factor of {spread:.3f}.",
        measured=f"over Gamma = {GAINS[0]:g} to {GAINS[-1]:g}, and with the implicit step, the estimates vary by "
        f"{span(smooth['MRAC'][:, 0])} per s (MRAC) and {span(smooth['L1'][:, 0])} per s (L1-AC). The largest variation is "
        f"{spread:.3f} times the smallest. With explicit Euler they vary by {span(rough[:, 0])} per s",
        how="the controller is sampled every 1e-4 s, and its step has a closed form that costs O(n^2) per sample; Section V, "
        "RK4, h = 1e-4 s, 20 s, first estimate",
        listings=(
            table(
                "The variation of the first estimate in the tail [1/s]",
                {"Gamma": GAINS, "MRAC": smooth["MRAC"][:, 0], "L1-AC": smooth["L1"][:, 0], "MRAC, explicit Euler": rough[:, 0]},
            ),
        ),
        would_change="estimates that chatter with this step at some gain and sample time, without a delay; sampled-delay treats delays",
    )


def _rates(scheme: str, discretization: str) -> Array:
    """Return the variation of the estimates in the tail (gains, n) [1/s]."""
    rates = []
    for gamma in GAINS:
        inner: Controller = Mrac(gamma=gamma, name="c") if scheme == "MRAC" else section_v.l1("c", gamma)
        sampled = Sampled(controller=inner, sample_time=1e-4, discretization=discretization)
        run = simulate(section_v.problem(), [sampled], Simulation(t_end=20.0, dt=1e-4, record_points=100))["c"]
        rates.append(run.metrics.theta_hat_variation_rate[0])
    return np.array(rates)


SAMPLE_TIME = 1e-3
DELAYS = (1e-3, 2e-3, 5e-3, 1e-2, 5e-2)
"""Delays [s], from one sample to fifty."""
DELAY_GAINS = (1.0, 1e2, 1e4, 1e6)
CHATTER_FACTOR = 30.0
"""Estimates are called quiet if their variation is at most this multiple of the variation without a delay. All others vary a
thousand times more."""


def delays() -> Claim:
    """Measure the error under a delay at the plant's input, in samples, over the gain: for midpoint steps with and without a
    filter, Euler steps, and the continuous law."""
    found = _by_form()
    errors, rates = found["MRAC, midpoint"]
    quiet = CHATTER_FACTOR * rates[-1, 0]
    ratio = float((errors / found["MRAC, Euler"][0])[:, 1:].max())
    tolerated = max(delay for delay, rate in zip((0.0, *DELAYS), rates[-1], strict=True) if rate <= quiet) / SAMPLE_TIME
    filtered_errors, filtered = found["L1-AC, midpoint"][0], found["L1-AC, midpoint"][1][-1]
    tolerated_by_l1 = max(delay for delay, rate in zip((0.0, *DELAYS), filtered, strict=True) if rate <= quiet) / SAMPLE_TIME
    larger = np.array(DELAYS)[errors[-1, 1:] > filtered_errors[-1, 1:]]
    sentence = SENTENCES["sampled-delay"]
    readings = (
        sentence.reads(tolerated_by_l1 > tolerated, f"{tolerated:g} T without the filter and {tolerated_by_l1:g} T with it"),
        Reading(
            "at every delay the tracking error is larger without the filter",
            len(larger) == len(DELAYS),
            f"larger at {len(larger)} of {len(DELAYS)} delays. Without the filter |e| is {errors[-1, 1]:.3g} at "
            f"{1e3 * DELAYS[0]:g} ms and {errors[-1, -1]:.3g} at {1e3 * DELAYS[-1]:g} ms; with it, {filtered_errors[-1, 1]:.3g} "
            f"and {filtered_errors[-1, -1]:.3g}",
            "beside",
        ),
    )
    return Claim(
        sentence=sentence,
        readings=readings,
        shows=f"At Gamma = {DELAY_GAINS[-1]:g} the estimates stay quiet up to a delay of {counted(round(tolerated), 'sample')} "
        f"of {SAMPLE_TIME:g} s without the filter and of {tolerated_by_l1:g} with it.",
        measured=f"at Gamma = {DELAY_GAINS[-1]:g} the estimates stay quiet up to a delay of {tolerated:g} T with MRAC in its "
        f"midpoint form and up to {tolerated_by_l1:g} T with L1-AC. Beyond {tolerated:g} T the estimates of MRAC swing between "
        f"their bounds. At every gain and delay |e| is at most {ratio:.2f} times that of the Euler form",
        how=f"T = {SAMPLE_TIME:g} s, h = T/2, RK4, 20 s, kappa = {section_v.KAPPA:g} s; estimates are quiet if they vary by at "
        f"most {CHATTER_FACTOR:g} times as much as without a delay",
        listings=(_listing(found, quiet),),
        would_change="a fast sampled law without a filter that stays quiet under a delay of two samples, or a filter that does "
        "not help under such a delay",
    )


def _by_form() -> dict[str, tuple[Array, Array]]:
    """Return the errors and rates of each controller in each form."""
    resolved = [gamma for gamma in DELAY_GAINS if gamma <= RESOLVED_GAIN]
    return {
        "MRAC, midpoint": _under_delays([_each_sample(_mrac(gamma), "midpoint") for gamma in DELAY_GAINS], SAMPLE_TIME / 2),
        "L1-AC, midpoint": _under_delays(
            [_each_sample(section_v.l1("c", gamma), "midpoint") for gamma in DELAY_GAINS], SAMPLE_TIME / 2
        ),
        "MRAC, Euler": _under_delays([_each_sample(_mrac(gamma), "euler") for gamma in DELAY_GAINS], SAMPLE_TIME / 2),
        "MRAC, continuous": _under_delays([_mrac(gamma) for gamma in resolved], 1e-4),
    }


def _listing(found: dict[str, tuple[Array, Array]], quiet: float) -> Listing:
    rows = [
        (form, f"{gamma:g}", *(f"{e:.3g}{'' if rate <= quiet else ' *'}" for e, rate in zip(errors, rates, strict=True)))
        for form, measured in found.items()
        for gamma, errors, rates in zip(DELAY_GAINS, *measured, strict=False)
    ]
    return Listing(
        caption="Largest |e| in the tail under a delay at the plant's input; * marks estimates that are not quiet",
        columns=("form", "Gamma", "no delay", *(f"{1e3 * delay:g} ms" for delay in DELAYS)),
        rows=tuple(rows),
    )


def _mrac(gamma: float) -> Mrac:
    return Mrac(gamma=gamma, name="c")


RESOLVED_GAIN = 1e2
"""The largest gain that 1e-4 s resolves in continuous time on this problem, where the adaptation's frequency is near
100 sqrt(Gamma)."""


def _each_sample(controller: Controller, discretization: str) -> Sampled:
    return Sampled(controller=controller, sample_time=SAMPLE_TIME, discretization=discretization)


def _under_delays(controllers: Sequence[Controller], dt: float) -> tuple[Array, Array]:
    """Return the largest |e| of the tail and the variation of the estimates [1/s], for each controller and delay. The first delay
    is zero."""
    given = variant()
    delayed = [replace(given, plant=replace(given.plant, input=PlantInput(delay=delay))) for delay in DELAYS]
    runs = [
        figures([(problem, controller) for controller in controllers for problem in problems], 20.0, dt)
        for problems in ([given], delayed)
    ]
    errors = [run.tail_max_abs_e.max(axis=1).reshape(len(controllers), -1) for run in runs]
    rates = [run.theta_hat_variation_rate.max(axis=1).reshape(len(controllers), -1) for run in runs]
    return np.hstack(errors), np.hstack(rates)


ROWS = (
    Measurement(claim, 1.6, {"sampled-midpoint": "a sampled law that is stable at every gain"}, place=190),
    Measurement(delays, 0.9, {"sampled-delay": "sampled controllers and delays"}, place=200),
)
