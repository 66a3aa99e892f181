"""Claims on unmodelled dynamics: what the filter, the gain and tau do to the margins."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from barbalat.actuation import PlantInput
from barbalat.certify.loops import around_equilibrium, fast_adaptation, known_parameters
from barbalat.certify.margins import margins
from barbalat.claims import section_v
from barbalat.claims.claim import Claim, verdict
from barbalat.claims.variants import figures, numbers, variant
from barbalat.closed_loop import ClosedLoop
from barbalat.controllers import Mrac
from barbalat.linear import TransferFunction, input_filter
from barbalat.protocols import Controller, Signal
from barbalat.signals import Constant, Sine
from barbalat.validate import Array

COMMANDS: dict[str, Signal] = {"r = 1": Constant(1.0), "r = 50": Constant(50.0), "r = 50 sin(0.5 t)": Sine(50.0, 0.5)}
DELAYS = np.geomspace(4e-4, 0.5, 49)


def claims() -> list[Claim]:
    """All of this group."""
    return [filter_and_margins(), gain_and_margins(), tau_and_error(), tau_against_delay(), tau_against_mu()]


def filter_and_margins() -> Claim:
    """Linear and simulated delay margins with and without the filter, at equal gain and with slow adaptation."""
    given = section_v.problem()
    plant, C = given.plant, input_filter(section_v.KAPPA).realise()
    slow = [margins(loop).delay for loop in (known_parameters(plant, plant.theta), known_parameters(plant, plant.theta, C))]
    fast = margins(fast_adaptation(plant, C)).delay
    adapting = [_adapting_delay_margin(c, 1.0) for c in (Mrac(gamma=100.0), section_v.l1("L1", 100.0))]
    measured = [
        f"{name}: {_tolerated(signal, lambda: Mrac(gamma=1.0)):.3g} s without, {_tolerated(signal, lambda: section_v.l1('L1', 1.0)):.3g} s with"
        for name, signal in COMMANDS.items()
    ]
    reduces_always = fast < adapting[0] and adapting[1] < adapting[0] and slow[1] < slow[0]
    return Claim(
        "filter-reduces-margins", "Section VI", "The filter reduces the robust stability margins no matter what size adaptive gains are used",
        verdict(holds=reduces_always),
        f"the filter changes the delay margin from {_change(slow)} with the estimates at rest on theta, from {_change(adapting)} with the "
        f"law working at Gamma = 100 around r = 1; for Gamma to infinity it is {fast:.3g} s with the filter, while without it the margin "
        "falls as 1/Gamma. Simulated, delay up to which the tail error stays below 10 % of the model's size, Gamma = 1: "
        + "; ".join(measured),
        "exact margins of the linear loops; Section V with an exact input delay, RK4, h = 1e-4 s, 60 s, 49 delays",
    )  # fmt: skip


def _change(pair: list[float]) -> str:
    without, with_filter = pair
    return f"{without:.3g} to {with_filter:.3g} s ({'up' if with_filter > without else 'down'})"


def _adapting_delay_margin(controller: Controller, r: float) -> float:
    return margins(around_equilibrium(ClosedLoop.of(section_v.problem(), controller), r)).delay


def _tolerated(signal: Signal, make: Callable[[], Controller]) -> float:
    """The largest delay up to which the error stays small beside the model's state; the criterion of this claim."""
    members = [(variant(reference=signal, input=PlantInput(delay=float(d))), make()) for d in DELAYS]
    tail = figures(members, 60.0, 1e-4).tail_max_abs_e[:, 0]
    size = 4 / 0.3 * signal.bound  # type: ignore[attr-defined]  # k_0 times the model's DC gain
    lost = np.flatnonzero(~(tail < 0.1 * size))
    return float(DELAYS[max(lost[0] - 1, 0)]) if len(lost) else float(DELAYS[-1])


def gain_and_margins() -> Claim:
    """The delay margin of the adapting loop against Gamma."""
    gains = (0.01, 1.0, 100.0, 1e4)
    unfiltered = np.array([_adapting_delay_margin(Mrac(gamma=g), 1.0) for g in gains])
    filtered = np.array([_adapting_delay_margin(section_v.l1("L1", g), 1.0) for g in gains])
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


def tau_against_delay() -> Claim:
    """The smallest tau that bears a delay."""
    delays = np.array([0.005, 0.01, 0.02, 0.05, 0.1])
    limits = np.array([_smallest_tau(PlantInput(delay=float(d))) for d in delays])
    ratio = limits / delays
    return Claim(
        "tau-limit-delay", "Theorem 2", "For a given modelling error tau has a lower limit, which grows with the error: input delay",
        verdict(holds=bool((np.diff(limits) > 0).all())),
        f"smallest tau {numbers(limits)} s for delays {numbers(delays)} s: {ratio.min():.2f} to {ratio.max():.2f} times the delay; the loop "
        f"1/(tau s) around that delay asks for 2/pi = {2 / np.pi:.2f}",
        "Section V, robust MRAC, exact delay, RK4, h = 1e-3 s, 60 s, 61 values of tau from 1e-3 to 1 s; lost: diverged",
    )  # fmt: skip


def tau_against_mu() -> Claim:
    """The smallest tau that bears Delta_m = -mu s/(0.001 s + 1)."""
    mus = np.array([0.005, 0.01, 0.02, 0.05])
    limits = np.array([_smallest_tau(PlantInput(multiplicative=TransferFunction([-float(m), 0.0], [1e-3, 1.0]))) for m in mus])
    ratio = limits / mus
    return Claim(
        "tau-limit-mu", "Section III.B, Theorem 2", "The same for Delta_m = -mu s",
        verdict(holds=bool((np.diff(limits) > 0).all())),
        f"smallest tau {numbers(limits)} s for mu {numbers(mus)} s: {ratio.min():.2f} to {ratio.max():.2f} times mu",
        "as for the delay, with Delta_m = -mu s/(0.001 s + 1), a proper realisation, h = 2e-4 s",
    )  # fmt: skip


def _smallest_tau(input: PlantInput) -> float:
    h = 1e-3 if input.dynamics is None else 2e-4
    members = [(variant(input=input), section_v.robust_mrac("r", float(t))) for t in TAUS]
    diverged: Array = ~np.isnan(figures(members, 60.0, h).diverged_at)
    lost = np.flatnonzero(diverged)
    return float(TAUS[lost[-1] + 1]) if len(lost) and lost[-1] + 1 < len(TAUS) else float(TAUS[0])
