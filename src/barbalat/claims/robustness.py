"""Claims on unmodelled dynamics: what the filter, the gain and tau do to the margins."""

from __future__ import annotations

import numpy as np

from barbalat.actuation import PlantInput
from barbalat.claims import filter_margins, section_v
from barbalat.claims.claim import Axis, Claim, Curve, Map, verdict
from barbalat.claims.filter_margins import adapting_delay_margin
from barbalat.claims.variants import figures, numbers, variant
from barbalat.controllers import Mrac
from barbalat.linear import TransferFunction
from barbalat.validate import Array


def claims() -> list[Claim]:
    """All of this group."""
    return [filter_margins.claim(), gain_and_margins(), tau_and_error(), tau_against_delay(), tau_against_mu()]


def gain_and_margins() -> Claim:
    """The delay margin of the adapting loop against Gamma."""
    gains = (0.01, 1.0, 100.0, 1e4)
    unfiltered = np.array([adapting_delay_margin(Mrac(gamma=g), 1.0) for g in gains])
    filtered = np.array([adapting_delay_margin(section_v.l1("L1", g), 1.0) for g in gains])
    return Claim(
        "gain-reduces-margins", "Sections I, III", "A high adaptive gain reduces robustness",
        verdict(holds=bool((np.diff(unfiltered) < 0).all()), conditional=bool(filtered[-1] > filtered[1])),
        f"delay margin around r = 1 for Gamma {numbers(np.array(gains))}: MRAC {numbers(unfiltered)} s, L1-AC {numbers(filtered)} s: true of "
        "MRAC, while with the filter the margin tends to a limit above zero",
        "exact margins of the loops linearised with the law inside, kappa = 0.02 s",
    )  # fmt: skip


def tau_and_error() -> Claim:
    """Without modelling error."""
    taus = np.array([0.1, 0.05, 0.02, 0.01, 0.005])
    peaks = figures([(section_v.problem(), section_v.robust_mrac("r", float(t))) for t in taus], 60.0, 1e-4).max_abs_e.max(axis=1)
    exponents = np.diff(np.log(peaks)) / np.diff(np.log(taus))
    return Claim(
        "tau-error", "Theorem 2, eq. (17)", "Without modelling error the transient error of the robust MRAC is proportional to tau",
        verdict(holds=bool((np.abs(exponents - 1) < 0.05).all())),
        f"max |e| {numbers(peaks)} for tau {numbers(taus)} s: exponents {numbers(exponents)}",
        "Section V, sign of (14) corrected, RK4, h = 1e-4 s, 60 s",
    )  # fmt: skip


TAUS = np.geomspace(1e-3, 1.0, 61)
DELAYS = np.geomspace(0.005, 0.1, 14)
MUS = np.geomspace(0.005, 0.05, 10)
DERIVATIVE_POLE = 1e-3
"""Time constant of the realisation of -mu s [s]."""


def tau_against_delay() -> Claim:
    """The smallest tau that bears a delay."""
    tail = _tail_errors([PlantInput(delay=float(d)) for d in DELAYS], 1e-3)
    limits = _smallest_tau(tail)
    known = ~np.isnan(limits)
    ratio = limits[known] / DELAYS[known]
    shown = Map(
        key="tau-delay",
        title="Theorem 2's trade-off: τ against an input delay",
        caption="Each cell is a run of the robust MRAC on Section V over 60 s with RK4, h = 1 ms, and an exact delay at the plant's "
        "input. Below the boundary the auxiliary input acts faster than the delay lets it: the loop 1/(τ s) around the delay asks "
        "for τ > 2/π times the delay. Above it the error grows with τ, as Theorem 2 says.",
        x=Axis("delay at the plant's input [s]", DELAYS, logarithmic=True),
        y=Axis("τ [s]", TAUS, logarithmic=True),
        values=tail.T,
        quantity="max |e| in the tail",
        logarithmic=True,
        curves=(
            Curve("small gain: τ = delay", DELAYS, DELAYS),
            Curve("1/(τ s) around the delay: τ = 2/π delay", DELAYS, 2 / np.pi * DELAYS),
        ),
    )
    return Claim(
        "tau-limit-delay", "Theorem 2", "For a given modelling error tau has a lower limit, which grows with the error: input delay",
        verdict(holds=bool((np.diff(limits[known]) >= 0).all() and limits[known][-1] > 2 * limits[known][0])),
        f"smallest tau {ratio.min():.2f} to {ratio.max():.2f} times the delay for delays {DELAYS[known][0]:.3g} to {DELAYS[known][-1]:.3g} s; "
        f"the auxiliary input's own loop 1/(tau s) around the delay asks for 2/pi = {2 / np.pi:.2f}, the small-gain theorem on that loop for 1: "
        "|e^(-j w d) - 1| <= w d and |1/(j w tau + 1)| < 1/(w tau)",
        f"Section V, robust MRAC, exact delay, RK4, h = 1e-3 s, 60 s, {len(DELAYS)} delays x {len(TAUS)} values of tau; lost: diverged",
        maps=(shown,),
    )  # fmt: skip


def tau_against_mu() -> Claim:
    """The smallest tau that bears Delta_m = -mu s/(0.001 s + 1)."""
    inputs = [PlantInput(multiplicative=TransferFunction([-float(m), 0.0], [DERIVATIVE_POLE, 1.0])) for m in MUS]
    tail = _tail_errors(inputs, 2e-4)
    limits = _smallest_tau(tail)
    known = ~np.isnan(limits)
    ratio = limits[known] / MUS[known]
    shown = Map(
        key="tau-mu",
        title="Theorem 2's trade-off: τ against Δₘ = -μs",
        caption="As for the delay, with Δₘ(s) = -μs/(0.001 s + 1), h = 0.2 ms. The line is the small-gain bound of the auxiliary "
        "input's own loop 1/(τ s), the plant's feedback left out.",
        x=Axis("μ [s]", MUS, logarithmic=True),
        y=Axis("τ [s]", TAUS, logarithmic=True),
        values=tail.T,
        quantity="max |e| in the tail",
        logarithmic=True,
        curves=(Curve("small gain: τ = μ", MUS, MUS),),
    )
    return Claim(
        "tau-limit-mu", "Section III.B, Theorem 2", "The same for Delta_m = -mu s",
        verdict(holds=bool((np.diff(limits[known]) >= 0).all() and limits[known][-1] > 2 * limits[known][0])),
        f"smallest tau {ratio.min():.2f} to {ratio.max():.2f} times mu for mu {MUS[known][0]:.3g} to {MUS[known][-1]:.3g} s",
        "as for the delay, with Delta_m = -mu s/(0.001 s + 1), a proper realisation, h = 2e-4 s",
        maps=(shown,),
    )  # fmt: skip


def _tail_errors(inputs: list[PlantInput], h: float) -> Array:
    """(len(inputs), len(TAUS)) max |e| over the tail; NaN where the run diverged."""
    members = [(variant(input=input), section_v.robust_mrac("r", float(tau))) for input in inputs for tau in TAUS]
    return np.asarray(figures(members, 60.0, h).tail_max_abs_e.max(axis=1)).reshape(len(inputs), len(TAUS))


def _smallest_tau(tail: Array) -> Array:
    """For each modelling error the smallest tau above which no run is lost; NaN where no run is."""
    limits = np.full(len(tail), np.nan)
    for i, row in enumerate(tail):
        lost = np.flatnonzero(np.isnan(row))
        if len(lost) and lost[-1] + 1 < len(TAUS):
            limits[i] = TAUS[lost[-1] + 1]
    return limits
