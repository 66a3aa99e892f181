"""What the filter and the gain do to the exact margins of the loop that adapts, around constant commands.

At the command r the estimates act through theta_hat' = Gamma x (...) with x proportional to r, and theta_hat'x: the loop
depends on Gamma r^2 alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from barbalat.certificates.linear_loops.around_equilibrium import around_equilibrium
from barbalat.certificates.linear_loops.ideal import fast_adaptation
from barbalat.claims import section_v
from barbalat.claims.claim import Axis, Chart, Claim, Curve, Map, Reading, of_readings, verdict
from barbalat.controllers import L1Adaptive, Mrac
from barbalat.linear.margins import Margins, margins
from barbalat.linear.systems import StateSpace, input_filter
from barbalat.validate import Array, InputError

GAINS = np.geomspace(1e-6, 1e8, 43)
"""Gamma r^2, three in a decade: from where the adaptation is too slow to matter, beyond Gamma = 1e4 at r = 50."""
KAPPAS = np.geomspace(1e-3, 0.4, 12)
"""The last is too slow for Section V's plant: the filtered loop is unstable."""
FIGURE_3_GAIN = 1e4 * 50**2
"""Gamma r^2 at Figure 3's gain and the crest of its command."""
MODERATE_KAPPA = 0.1
"""The filters up to here, twice what Theorem 1's condition admits, are those of which the gain margin is claimed to fall."""
SHOWN_KAPPAS = (0.005, section_v.KAPPA, 0.05)
"""The filters of the chart."""
HOW = "exact margins of the loops linearised with the law inside, Section V's plant at constant r; the loop depends on Gamma r^2 alone"


@dataclass(frozen=True)
class FilterEffect:
    """What the filter does to the exact margins around constant commands: read as either margin, and drawn."""

    readings: tuple[Reading, ...]
    maps: tuple[Map, ...]
    gain_margins: tuple[float, float]


def filter_effect() -> FilterEffect:
    """The ratio of the margins with and without the filter, over Gamma and kappa."""
    without, scans = _scan(None), [_scan(float(kappa)) for kappa in KAPPAS]
    delay = np.array([_ratios(scan, without, lambda m: m.delay) for scan in scans])
    gain = np.array([_ratios(scan, without, lambda m: m.gain_up - 1) for scan in scans])
    rows = [i for i, row in enumerate(delay) if not np.isnan(row).any()]
    equal = np.array([_equal_at(float(KAPPAS[i]), delay[i]) for i in rows])
    line = Curve("ratio 1", equal, KAPPAS[rows])
    at = _equal_at(section_v.KAPPA, _ratios(_scan(section_v.KAPPA), without, lambda m: m.delay))
    moderate = gain[KAPPAS <= MODERATE_KAPPA]
    beyond = gain[KAPPAS > MODERATE_KAPPA]
    plain, filtered = (margins(loop(kappa)(FIGURE_3_GAIN)).gain_up for kappa in (None, section_v.KAPPA))
    readings = (
        Reading(
            "the gain margin of the loop that adapts: exact, around constant commands",
            verdict(holds=bool(moderate.max() < 1), conditional=not (beyond < 1).all()),
            f"k = {plain:.4g} to {filtered:.4g} at Figure 3's gain, kappa = {section_v.KAPPA:g} s and r = 50; true of all {moderate.size} cells with "
            f"kappa <= {MODERATE_KAPPA:g} s, twice what Theorem 1's condition admits, where k - 1 falls to {moderate.min():.2g} to {moderate.max():.2g} of what it is without "
            f"the filter. Slower filters: {_slower(gain)}",
        ),
        Reading(
            "the delay margin of the loop that adapts: exact, around constant commands",
            verdict(holds=bool((delay[rows] < 1).all())),
            f"kappa = {section_v.KAPPA:g} s: true for Gamma r^2 < {at:.2g}, that is Gamma < {at:.2g} at r = 1 and Gamma < {at / 2500:.2g} at r = 50; "
            f"above, the filter raises it. For kappa {KAPPAS[rows[0]]:.3g} to {KAPPAS[rows[-1]]:.3g} s that limit is {equal.min():.2g} to {equal.max():.2g}",
        ),
    )
    return FilterEffect(readings, (_delay_map(delay, line), _gain_map(gain)), (plain, filtered))


def _slower(ratios: Array) -> str:
    """What the filters beyond ``MODERATE_KAPPA`` do to the gain margin, in every cell of theirs."""
    said = []
    for kappa, row in zip(KAPPAS, ratios, strict=True):
        if kappa <= MODERATE_KAPPA:
            continue
        raised, lost = row >= 1, np.isnan(row)
        text = f"kappa = {kappa:.3g} s falls in {int((row < 1).sum())} of {len(row)} cells"
        if raised.any():
            at = ", ".join(f"{gain:.2g}" for gain in GAINS[raised])
            text += f", rises in {int(raised.sum())} (Gamma r^2 = {at}, to {row[raised].max():.3g} of what it is)"
        if lost.any():
            text += f", is unstable with the filter in {int(lost.sum())}"
        said.append(text)
    return "; ".join(said)


def gain_reduces_margins() -> Claim:
    """The delay margin over Gamma, with and without the filter."""
    curves = {"MRAC": _delays(_scan(None))} | {f"L1-AC, κ = {kappa:g} s": _delays(_scan(kappa)) for kappa in SHOWN_KAPPAS}
    plain, filtered = curves["MRAC"], curves[f"L1-AC, κ = {section_v.KAPPA:g} s"]
    lowest, C = int(filtered.argmin()), input_filter(section_v.KAPPA).realise()
    limit = margins(fast_adaptation(section_v.problem().plant, C)).delay
    back = int(np.flatnonzero(filtered < limit / 2)[-1]) + 1
    slope = np.log(plain[-1] / plain[-4]) / np.log(GAINS[-1] / GAINS[-4])
    chart = Chart(
        key="delay-margin-gain",
        title="The delay margin of the loop that adapts, against the gain",
        caption=(
            "Exact, of the loops linearised with the law inside, Section V's plant around a constant command r; they depend on Γr² alone. "
            "With the filter the margin falls as long as the resonance of the adaptation crosses |L| = 1, and returns to the limit of "
            "fast adaptation, near 1.6 κ here, where it no longer does."
        ),
        x=Axis("Γr²", GAINS, logarithmic=True),
        quantity="delay margin [s]",
        curves=tuple(Curve(label, GAINS, values) for label, values in curves.items()),
    )
    readings = (
        Reading(
            "MRAC", verdict(holds=bool((np.diff(plain) < 0).all())), f"{plain[0]:.3g} s falls at every step, to {plain[-1]:.2g} s"
        ),
        Reading(
            f"L1-AC, kappa = {section_v.KAPPA:g} s",
            verdict(holds=bool((np.diff(filtered) < 0).all())),
            f"{filtered[0]:.3g} s falls to {filtered[lowest]:.2g} s and returns to {filtered[-1]:.3g} s",
        ),
    )
    return Claim(
        "gain-reduces-margins", "Section III.A, last paragraph; Section III.B, last paragraph", "A high adaptive gain reduces robustness",
        of_readings(readings),
        f"delay margin over {len(GAINS)} values of Gamma r^2 from {GAINS[0]:g} to {GAINS[-1]:g}: true of MRAC at every step, {plain[0]:.3g} s to {plain[-1]:.2g} s, at last as "
        f"Gamma^{slope:.2f}. L1-AC (kappa = {section_v.KAPPA:g} s) is not monotone: {filtered[0]:.3g} s falls to {filtered[lowest]:.2g} s at Gamma r^2 = {GAINS[lowest]:.2g}, "
        f"from {GAINS[back]:.2g} on it is at least {filtered[back:].min():.3g} s, and tends to {limit:.3g} s",
        HOW,
        maps=(chart,),
        number=f"delay margin of MRAC as Gamma^{slope:.2f}; of L1-AC {filtered[lowest]:.2g} s at its least, {limit:.3g} s in the limit",
        readings=readings,
        condition="no filter is at the input; with one, not beyond the gain at which the margin is least",
        would_change="an MRAC whose margin does not fall with the gain, or an L1-AC whose margin falls at all gains",
    )  # fmt: skip


def _delays(scan: list[Margins | None]) -> Array:
    return np.array([np.nan if found is None else found.delay for found in scan])


def _delay_map(ratios: Array, line: Curve) -> Map:
    return Map(
        key="filter-delay-margin",
        title="The filter's effect on the delay margin of the loop that adapts",
        caption=(
            "The delay margin of L1-AC's loop over that of MRAC's at the same gain, each linearised around a constant command r with its law "
            "inside. To the left of the line the filter costs margin, to the right it raises it: MRAC's margin falls as 1/Γ, and L1-AC's returns to that of the limit of fast "
            "adaptation (the step in the colours)."
        ),
        x=Axis("Γr²", GAINS, logarithmic=True),
        y=Axis("filter time constant κ [s]", KAPPAS, logarithmic=True),
        values=ratios,
        quantity="delay margin with/without filter",
        logarithmic=True,
        lost="unstable with filter",
        curves=(line, _section_v()),
    )


def _gain_map(ratios: Array) -> Map:
    return Map(
        key="filter-gain-margin",
        title="The filter's effect on the gain margin of the loop that adapts",
        caption=(
            "As for the delay margin: k - 1 with the filter over k - 1 without it, k the gain margin. The filter makes the loop's relative "
            "degree larger, and the resonance of the adaptation bears less gain, however fast it is."
        ),
        x=Axis("Γr²", GAINS, logarithmic=True),
        y=Axis("filter time constant κ [s]", KAPPAS, logarithmic=True),
        values=ratios,
        quantity="(k - 1) with/without filter",
        logarithmic=True,
        lost="unstable with filter",
        curves=(_section_v(),),
    )


def _section_v() -> Curve:
    """Figure 3's gain and filter, at the two commands."""
    return Curve("Figure 3's Γ and κ at r = 1, r = 50", np.array([1e4, FIGURE_3_GAIN]), [section_v.KAPPA] * 2, marks=True)


@cache
def loop(kappa: float | None) -> Callable[[float], StateSpace]:
    """From Gamma r^2 to the adapting loop around a constant command; without a filter for ``None``.

    Gamma is a factor of the law alone, so the loop's matrix is affine in it: two exact linearisations give all.
    """
    one, two = (around_equilibrium(section_v.problem(), _controller(gamma, kappa), 1.0) for gamma in (1.0, 2.0))
    return lambda gamma: StateSpace(one.A + (gamma - 1) * (two.A - one.A), one.B, one.C, one.D)


def _controller(gamma: float, kappa: float | None) -> Mrac | L1Adaptive:
    return Mrac(gamma=gamma) if kappa is None else section_v.l1("L1", gamma, kappa)


def _scan(kappa: float | None) -> list[Margins | None]:
    """Over ``GAINS``; ``None`` where the loop is unstable."""
    at = loop(kappa)
    return [_margins(at(float(gamma))) for gamma in GAINS]


def _margins(loop: StateSpace) -> Margins | None:
    try:
        return margins(loop)
    except InputError:  # the loop is unstable, which is an answer here
        return None


def _ratios(with_filter: list[Margins | None], without: list[Margins | None], of: Callable[[Margins], float]) -> Array:
    """NaN where one of the loops is unstable."""
    pairs = zip(with_filter, without, strict=True)
    return np.array([np.nan if f is None or m is None else of(f) / of(m) for f, m in pairs])


def _equal_at(kappa: float, ratios: Array) -> float:
    """The Gamma r^2 at which the filter leaves the delay margin as it was: the last crossing of the scan, refined."""
    from scipy.optimize import brentq

    k = int(np.flatnonzero((ratios[:-1] < 1) & (ratios[1:] >= 1))[-1])
    filtered, plain = loop(kappa), loop(None)

    def change(exponent: float) -> float:
        return float(np.log(margins(filtered(10**exponent)).delay / margins(plain(10**exponent)).delay))

    return float(10 ** brentq(change, np.log10(GAINS[k]), np.log10(GAINS[k + 1]), rtol=1e-6))
