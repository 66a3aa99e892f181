"""The loops of MRAC and L1-AC around x' = -a x + b (u + sigma) with a constant, unknown sigma, broken at the plant's input.

Both schemes estimate sigma_hat' = Gamma P b x_tilde with the predictor x_hat' = -a x_hat + b (u + sigma_hat), and
u = -C sigma_hat. With v at the plant's input and u the controller's output, sigma_hat = F (v - u), where
F = w^2/(s^2 + a s + w^2) and w^2 = Gamma P b^2. Therefore L = -u/v = C F/(1 - C F). C = 1 gives MRAC and
C = 1/(kappa s + 1) gives L1-AC, whose limit of fast adaptation is L = 1/(kappa s).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from barbalat.linear.margins import margins
from barbalat.linear.peaks import peak_gain
from barbalat.linear.systems import TransferFunction, complementary_sensitivity
from barbalat.papers.cao_2006.sentences import SENTENCES
from barbalat.papers.claim import Claim, Listing, Measurement, span, table
from barbalat.papers.finding import Reading
from barbalat.validate import Array

A, B = 1.0, 1.0
"""The magnitude of the plant's pole [1/s]. Every stable first-order plant becomes this one by scaling time and x."""
P = 1 / (2 * A)
"""-2 a P = -1."""
GAINS = np.geomspace(1e-2, 1e8, 31)
"""Three gains per decade. At the smallest one the adaptation is too slow to matter."""
KAPPAS = (0.02, 0.1, 1.0)
"""Time constants of the filters [s]. Their bandwidths are fifty times, ten times and once that of the plant."""
UNCHANGED_SHARE = 0.1
HOW = (
    f"a loop of our own, because only the abstract was available. The plant is x' = -x + u + sigma, which by scaling represents "
    f"every stable first-order plant. The exact margins of L = C F/(1 - C F), broken at the plant's input, are computed for "
    f"{len(GAINS)} gains from {GAINS[0]:g} to {GAINS[-1]:g}"
)


def loop(gamma: float, kappa: float | None) -> TransferFunction:
    """Return L of L1-AC with the filter's time constant kappa [s], or of MRAC if kappa is ``None``."""
    w = gamma * P * B**2
    if kappa is None:
        return TransferFunction([w], [1.0, A, 0.0])
    return TransferFunction([w], [kappa, kappa * A + 1, kappa * w + A, 0.0])


@dataclass(frozen=True, eq=False)
class OverGains:
    """The phase margins [rad] and delay margins [s] over ``GAINS``."""

    phase: Array
    delay: Array


@cache
def over_gains(kappa: float | None) -> OverGains:
    """Return the exact margins of one scheme."""
    found = [margins(loop(float(gamma), kappa).realise()) for gamma in GAINS]
    return OverGains(np.array([one.phase for one in found]), np.array([one.delay for one in found]))


def _listing() -> Listing:
    told = slice(0, None, 6)
    columns = {"Gamma": GAINS[told], "MRAC, phase": over_gains(None).phase[told], "MRAC, delay [s]": over_gains(None).delay[told]}
    for kappa in KAPPAS:
        columns |= {
            f"{kappa:g} s, phase": over_gains(kappa).phase[told],
            f"{kappa:g} s, delay [s]": over_gains(kappa).delay[told],
        }
    caption = "Exact phase margins [rad] and delay margins [s] against the gain, for MRAC and for L1-AC with each kappa"
    return table(caption, columns)


def mrac() -> list[Claim]:
    """What a high gain does to a loop that contains it."""
    found, phase, delay = over_gains(None), SENTENCES["high-gain-phase"], SENTENCES["high-gain-delay"]
    poles = [np.roots(np.polyadd(loop(float(gamma), None).den, loop(float(gamma), None).num)) for gamma in GAINS]
    frequencies = np.array([np.abs(one).max() for one in poles])
    damping = float((-poles[-1].real / np.abs(poles[-1])).min())
    smaller = [bool(values[-1] < (1 - UNCHANGED_SHARE) * values[0]) for values in (found.phase, found.delay)]
    effort = np.array([peak_gain(complementary_sensitivity(loop(float(gamma), None).realise())).gain for gamma in GAINS[[0, -1]]])
    return [
        Claim(
            sentence=phase,
            readings=(
                phase.reads(bool(effort[1] > (1 + UNCHANGED_SHARE) * effort[0]), f"{effort[0]:.3g} at the lowest gain and "
                f"{effort[1]:.3g} at the highest"),
                phase.reads(smaller[0], f"{found.phase[0]:.3g} rad at the lowest gain, {found.phase[-1]:.2g} rad at the "
                f"highest", 1),
            ),
            shows=f"As the gain grows, the peak of MRAC's control rises from {effort[0]:.2g} to {effort[1]:.0f} times the "
            f"disturbance, and the phase margin falls from {found.phase[0]:.3g} to {found.phase[-1]:.1g} rad.",
            measured=f"the peak gain from the disturbance to the control, T = L/(1 + L), rises from {effort[0]:.3g} to "
            f"{effort[1]:.4g}; MRAC's phase margin falls from {found.phase[0]:.3g} to {found.phase[-1]:.2g} rad over "
            f"{len(GAINS)} gains",
            how=HOW, listings=(_listing(),), would_change="a phase margin that is no smaller at the highest gain than at the "
            "lowest, or a different measure of the control effort, which the abstract does not define",
        ),
        Claim(
            sentence=delay,
            readings=(
                delay.reads(bool(damping < 0.01 and frequencies[-1] > frequencies[0]), f"{frequencies[-1]:.3g} rad/s with a "
                f"damping ratio of {damping:.1g} at the highest gain"),
                delay.reads(smaller[1], f"{found.delay[0]:.3g} s at the lowest gain, {found.delay[-1]:.2g} s at the highest", 1),
            ),
            shows=f"MRAC's delay margin falls from {found.delay[0]:.3g} to {found.delay[-1]:.1g} s and its damping ratio to "
            f"{damping:.0e}.",
            measured=f"at Gamma = {GAINS[-1]:g} the loop has a mode of {frequencies[-1]:.3g} rad/s with a damping ratio of "
            f"{damping:.2g}, and tolerates a delay of {found.delay[-1]:.2g} s",
            how=HOW, listings=(_listing(),), would_change="a delay margin that is no smaller at the highest gain, or a mode "
            "that is well damped there",
        ),
    ]  # fmt: skip


def l1() -> list[Claim]:
    """What a high gain does to a loop if only its predictor contains it."""
    return [_phase(), _delay(), _inside()]


def _phase() -> Claim:
    sentence, phases = SENTENCES["phase-independent"], {kappa: over_gains(kappa).phase for kappa in KAPPAS}
    same = {kappa: bool(values.max() < values.min() * (1 + UNCHANGED_SHARE)) for kappa, values in phases.items()}
    fast = {kappa: _from_where(values) for kappa, values in phases.items()}
    told = "; ".join(f"{values.min():.2g} to {values.max():.3g} rad with kappa = {kappa:g} s" for kappa, values in phases.items())
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(all(same.values()), told),
            Reading(
                "fast adaptation: above some gain, which depends on the filter, the phase margin is that of 1/(kappa s) to "
                "within a tenth",
                all(np.isfinite(list(fast.values()))),
                "; ".join(f"above Gamma = {gain:.2g} with kappa = {kappa:g} s" for kappa, gain in fast.items()) + "; this "
                "margin is a quarter turn, 1.57 rad",
                "beside",
            ),
        ),
        shows=f"On our first-order loop with kappa = {KAPPAS[0]:g} s the phase margin falls from {phases[KAPPAS[0]][0]:.2g} rad "
        f"to {phases[KAPPAS[0]].min():.1g} and returns to {phases[KAPPAS[0]][-1]:.3g}. Above Gamma = {fast[KAPPAS[0]]:.1e} it "
        "stays within 10 % of pi/2.",
        measured=f"the phase margin is {told}",
        how=HOW, listings=(_listing(),), would_change="a different break point of the loop, or the plant and gains of the "
        "paper, which are not available",
    )  # fmt: skip


def _from_where(phases: Array) -> float:
    """Return the gain above which the phase margin stays within 10 % of 90 deg; infinity if it is farther away at the highest
    gain."""
    away = np.flatnonzero(np.abs(phases / (np.pi / 2) - 1) > UNCHANGED_SHARE)
    first = int(away[-1]) + 1 if len(away) else 0
    return float(GAINS[first]) if first < len(GAINS) else np.inf


def _delay() -> Claim:
    sentence, delays = SENTENCES["delay-bounded"], {kappa: over_gains(kappa).delay for kappa in KAPPAS}
    late = GAINS[-1] / 10.001 <= GAINS
    steady = all(
        values[late].min() > 0 and values[late].max() < values[late].min() * (1 + UNCHANGED_SHARE) for values in delays.values()
    )
    told = "; ".join(
        f"{span(values[late])} s with kappa = {kappa:g} s (the smallest at any gain is {values.min():.2g} s)"
        for kappa, values in delays.items()
    )
    return Claim(
        sentence=sentence,
        readings=(sentence.reads(steady, f"over the last decade {told}"),),
        shows=f"With kappa = {KAPPAS[0]:g} s the delay margin is {delays[KAPPAS[0]][-1]:.3g} s at the highest gain, after a dip "
        f"to {delays[KAPPAS[0]].min():.2g} s at Gamma = {GAINS[int(delays[KAPPAS[0]].argmin())]:.1e}; that of MRAC is "
        f"{over_gains(None).delay[-1]:.0e} s.",
        measured=f"over the last decade of gain the delay margin is {told}; the limit of fast adaptation is pi kappa/2",
        how=HOW, listings=(_listing(),), would_change="a delay margin that keeps falling with the gain",
    )  # fmt: skip


def _inside() -> Claim:
    sentence = SENTENCES["high-gain-inside"]
    rises, first = [], over_gains(KAPPAS[0])
    for kappa in KAPPAS:
        found, least = over_gains(kappa), int(over_gains(kappa).delay.argmin())
        if found.delay[-1] > found.delay[least] and found.phase[-1] > found.phase[least]:
            rises.append(
                f"with kappa = {kappa:g} s, from Gamma = {GAINS[least]:.2g} to {GAINS[-1]:.2g}, the delay margin rises from "
                f"{found.delay[least]:.2g} to {found.delay[-1]:.3g} s and the phase margin from {found.phase[least]:.2g} to "
                f"{found.phase[-1]:.3g} rad"
            )
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(bool(rises), "; ".join(rises) or f"no rise with any of {len(KAPPAS)} filters"),
            Reading(
                "with each filter, both margins are larger at the highest gain than with the slowest adaptation tried",
                all(np.all([values[-1] > values[0] for values in (over_gains(kappa).phase, over_gains(kappa).delay)]) for kappa in KAPPAS),
                "; ".join(f"with kappa = {kappa:g} s the delay margin is {over_gains(kappa).delay[0]:.3g} s at Gamma = "
                f"{GAINS[0]:g} and {over_gains(kappa).delay[-1]:.3g} s at {GAINS[-1]:g}" for kappa in KAPPAS),
                "beside",
            ),
        ),
        shows=f"With kappa = {KAPPAS[0]:g} s, an increase of the gain first lowers the delay margin from {first.delay[0]:.3g} to "
        f"{first.delay.min():.2g} s; a further increase restores it to {first.delay[-1]:.3g} s.",
        measured="; ".join(rises) or f"no rise with any of {len(KAPPAS)} filters",
        how=HOW, listings=(_listing(),), would_change="margins that fall with every increase of the gain for each filter",
    )  # fmt: skip


ROWS = (
    Measurement(
        mrac,
        0.2,
        {"high-gain-phase": "MRAC's control effort and phase margin", "high-gain-delay": "MRAC's delay margin"},
        place=10,
        quick=True,
    ),
    Measurement(
        l1,
        0.3,
        {
            "phase-independent": "L1-AC's phase margin",
            "delay-bounded": "L1-AC's delay margin",
            "high-gain-inside": "a high gain in the predictor",
        },
        place=20,
        quick=True,
    ),
)
