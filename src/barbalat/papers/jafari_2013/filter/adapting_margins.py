"""The filter's effect on the exact margins of the adapting loop, around constant commands.

The estimates act through the law theta_hat' = Gamma x (...) and through the product theta_hat'x. At the command r, x is
proportional to r, so the loop depends only on Gamma r^2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from barbalat.certificates.linear_loops.ideal import around_equilibrium
from barbalat.controllers import L1Adaptive, Mrac
from barbalat.linear.margins import Margins, margins
from barbalat.linear.peaks import peak_gain
from barbalat.linear.systems import StateSpace, complementary_sensitivity
from barbalat.papers.claim import ChartAxis, Curve, Map
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.validate import Array, InputError

GAINS = np.geomspace(1e-6, 1e8, 43)
"""Values of Gamma r^2, three per decade. They range from adaptation too slow to matter to beyond Gamma = 1e4 at r = 50."""
KAPPAS = np.geomspace(1e-3, 0.4, 12)
"""Time constants of the filter [s]. With the last one, which is too slow for Section V's plant, the loop is unstable."""
COMMAND_CREST = 50.0
"""The crest of Section V's command."""
FIGURE_3_GAIN = 1e4 * COMMAND_CREST**2
"""Gamma r^2 at Figure 3's gain and the crest of its command."""
TOLD_GAINS = (0.01, 100.0, FIGURE_3_GAIN)
"""Values of Gamma r^2 at which the readings state the margins: slow adaptation, a value near L1-AC's smallest delay margin, and
the value of Figure 3."""
MODERATE_KAPPA = 0.1
"""The gain margin is claimed to fall with filters up to this kappa [s], twice the largest that Theorem 1's condition admits."""
METHOD = (
    "exact margins of the loops linearised together with the adaptive law, for Section V's plant at constant r; the loop "
    "depends only on Gamma r^2"
)


class LoopMargins(NamedTuple):
    """The margins of a stable loop.

    small_gain  1/||T||_inf; a Delta_m of (11) that is smaller at every frequency cannot destabilise the loop
    """

    margins: Margins
    small_gain: float


UPWARDS, DOWNWARDS = "gain margin upwards", "gain margin downwards"
MARGINS: dict[str, Callable[[LoopMargins], float]] = {
    UPWARDS: lambda tolerated: tolerated.margins.gain_up - 1,
    DOWNWARDS: lambda tolerated: 1 - tolerated.margins.gain_down,
    "phase margin": lambda tolerated: tolerated.margins.phase,
    "delay margin": lambda tolerated: tolerated.margins.delay,
    "small-gain margin 1/||T||_inf": lambda tolerated: tolerated.small_gain,
}
"""The margins, keyed by name: k - 1 and 1 - k for the gain margins k, the phase margin [rad], the delay margin [s], and the
smallest destabilising size of Delta_m. Each is zero for a loop without margin."""


@dataclass(frozen=True)
class FilterEffect:
    """The filter's effect on the exact margins around constant commands, for each of ``MARGINS`` and as maps.

    fall_at_every_gain  names of the margins that are smaller in every cell with a moderate filter
    rise_at_high_gain   names of the margins that are larger in all these cells at the largest gain
    """

    readings: tuple[Reading, ...]
    maps: tuple[Map, ...]
    gain_margins: tuple[float, float]
    fall_at_every_gain: tuple[str, ...]
    rise_at_high_gain: tuple[str, ...]


def filter_effect() -> FilterEffect:
    """Compute the ratio of the margins with and without the filter, over Gamma and kappa."""
    without, scans = scan(None), [scan(float(kappa)) for kappa in KAPPAS]
    ratios = {name: np.array([_ratios(each, without, of) for each in scans]) for name, of in MARGINS.items()}
    delay = ratios["delay margin"]
    rows = [i for i, row in enumerate(delay) if not np.isnan(row).any()]
    line = Curve("ratio 1", np.array([_equal_at(float(KAPPAS[i]), delay[i]) for i in rows]), KAPPAS[rows])
    moderate = {name: found[KAPPAS <= MODERATE_KAPPA] for name, found in ratios.items()}
    plain, filtered = (margins(loop(kappa)(FIGURE_3_GAIN)).gain_up for kappa in (None, section_v.KAPPA))
    return FilterEffect(
        (_upwards(ratios[UPWARDS], plain, filtered), *(_reading(name, moderate[name]) for name in MARGINS if name != UPWARDS)),
        (_delay_map(delay, line), _gain_map(ratios[UPWARDS])),
        (plain, filtered),
        fall_at_every_gain=tuple(name for name, found in moderate.items() if (found < 1).all()),
        rise_at_high_gain=tuple(name for name, found in moderate.items() if (found[:, -1] > 1).all()),
    )


def _upwards(ratios: Array, plain: float, filtered: float) -> Reading:
    """Return the reading on the margin that every moderate filter reduces. Slow filters that do not are listed one by one."""
    moderate = ratios[KAPPAS <= MODERATE_KAPPA]
    return Reading(
        f"the filter lowers the {UPWARDS} of the adapting loop: exact, around constant commands",
        bool(moderate.max() < 1),
        f"k goes from {plain:.4g} to {filtered:.4g} at Figure 3's gain, kappa = {section_v.KAPPA:g} s and r = 50; this holds in "
        f"all {moderate.size} cells with kappa <= {MODERATE_KAPPA:g} s, twice the limit of Theorem 1's condition; there k - 1 "
        f"is {moderate.min():.2g} to {moderate.max():.2g} times its value without the filter. Slower filters: "
        f"{_slower(ratios)}",
        "beside",
    )


def _reading(name: str, moderate: Array) -> Reading:
    """Return the reading on one of the other margins: the number of cells with a moderate filter in which it falls, and the gains
    at which Section V's filter raises it."""
    of, (without, filtered) = MARGINS[name], (scan(None), scan(section_v.KAPPA))
    raised = np.array([of(f) > of(m) for f, m in zip(filtered, without, strict=True) if f is not None and m is not None])
    said = f"the filter raises it at {int(raised.sum())} of {len(raised)} gains"
    if raised.any():
        first, last = GAINS[raised][0], GAINS[raised][-1]
        said += (
            f", Gamma r^2 = {first:.2g} to {last:.2g}, that is Gamma = {first / COMMAND_CREST**2:.2g} to "
            f"{last / COMMAND_CREST**2:.2g} at r = {COMMAND_CREST:g}"
        )
    at = "; ".join(f"{changed(name, gain)} at Gamma r^2 = {gain:.3g}" for gain in TOLD_GAINS)
    return Reading(
        f"the filter lowers the {name} of the adapting loop: exact, around constant commands",
        bool((moderate < 1).all()),
        f"kappa = {section_v.KAPPA:g} s: {at}; {said}. The filter lowers it in {int((moderate < 1).sum())} of {moderate.size} "
        f"cells with kappa <= {MODERATE_KAPPA:g} s",
        "beside",
    )


def changed(name: str, gain: float) -> str:
    """Return a phrase with the values without and with the filter. The downward gain margin is given as the factor itself, so a
    smaller number is better."""
    plain, filtered = (tolerates(loop(kappa)(gain)) for kappa in (None, section_v.KAPPA))
    assert plain is not None and filtered is not None
    of = MARGINS[name] if name != DOWNWARDS else (lambda tolerated: tolerated.margins.gain_down)
    return f"{'k = ' if name == DOWNWARDS else ''}{of(plain):.3g} to {of(filtered):.3g}"


def _slower(ratios: Array) -> str:
    """Return a phrase on how filters slower than ``MODERATE_KAPPA`` change the gain margin in their cells."""
    said = []
    for kappa, row in zip(KAPPAS, ratios, strict=True):
        if kappa <= MODERATE_KAPPA:
            continue
        raised, lost = row >= 1, np.isnan(row)
        text = f"with kappa = {kappa:.3g} s, k - 1 falls in {int((row < 1).sum())} of {len(row)} cells"
        if raised.any():
            at = ", ".join(f"{gain:.2g}" for gain in GAINS[raised])
            text += (
                f", rises in {int(raised.sum())} (Gamma r^2 = {at}, to {row[raised].max():.3g} times its value without the "
                f"filter)"
            )
        if lost.any():
            text += f", and the loop with the filter is unstable in {int(lost.sum())}"
        said.append(text)
    return "; ".join(said)


def _delay_map(ratios: Array, line: Curve) -> Map:
    return Map(
        key="filter-delay-margin",
        title="The filter's effect on the delay margin of the adapting loop",
        caption=(
            "The ratio of the delay margins of the L1-AC and MRAC loops at the same gain. Each loop, including its adaptive "
            "law, is linearised around a constant command r. To the left of the line the filter reduces the margin, and to the "
            "right it increases it. MRAC's margin falls as 1/Γ; L1-AC's margin returns to its value in the limit of fast "
            "adaptation, which causes the step in the colours."
        ),
        x=ChartAxis("Γr²", GAINS, logarithmic=True),
        y=ChartAxis("filter time constant κ [s]", KAPPAS, logarithmic=True),
        values=ratios,
        quantity="delay margin with / without the filter",
        logarithmic=True,
        lost="unstable with filter",
        curves=(line, _section_v()),
    )


def _gain_map(ratios: Array) -> Map:
    return Map(
        key="filter-gain-margin",
        title="The filter's effect on the gain margin of the adapting loop",
        caption=(
            "This map shows the same for the gain margin k: k - 1 with the filter divided by k - 1 without it. The filter "
            "increases the loop's relative degree, so the resonance of the adaptation tolerates less gain, however fast the "
            "adaptation is."
        ),
        x=ChartAxis("Γr²", GAINS, logarithmic=True),
        y=ChartAxis("filter time constant κ [s]", KAPPAS, logarithmic=True),
        values=ratios,
        quantity="(k - 1) with/without filter",
        logarithmic=True,
        lost="unstable with filter",
        curves=(_section_v(),),
    )


def _section_v() -> Curve:
    """Return marks at Figure 3's gain and filter for the two commands."""
    return Curve("Figure 3's Γ and κ at r = 1, r = 50", np.array([1e4, FIGURE_3_GAIN]), [section_v.KAPPA] * 2, marks=True)


@cache
def loop(kappa: float | None) -> Callable[[float], StateSpace]:
    """Return a function from Gamma r^2 to the adapting loop around a constant command, without a filter if kappa is ``None``.

    Gamma only multiplies the law, so the loop's matrix is affine in it and follows from two exact linearisations.
    """
    one, two = (around_equilibrium(section_v.problem(), _controller(gamma, kappa), 1.0) for gamma in (1.0, 2.0))
    return lambda gamma: StateSpace(one.A + (gamma - 1) * (two.A - one.A), one.B, one.C, one.D)


def _controller(gamma: float, kappa: float | None) -> Mrac | L1Adaptive:
    return Mrac(gamma=gamma) if kappa is None else section_v.l1("L1", gamma, kappa)


@cache
def scan(kappa: float | None) -> tuple[LoopMargins | None, ...]:
    """Return the margins over ``GAINS``, each ``None`` if the loop is unstable."""
    at = loop(kappa)
    return tuple(tolerates(at(float(gamma))) for gamma in GAINS)


def tolerates(loop: StateSpace) -> LoopMargins | None:
    """Return the margins of the loop, or ``None`` if it is unstable."""
    try:
        found = margins(loop)
    except InputError:  # the loop is unstable, which is a valid result here
        return None
    return LoopMargins(found, 1 / peak_gain(complementary_sensitivity(loop)).gain)


def _ratios(
    with_filter: Sequence[LoopMargins | None], without: Sequence[LoopMargins | None], of: Callable[[LoopMargins], float]
) -> Array:
    """Return the ratios of the margins, NaN if one of the loops is unstable."""
    pairs = zip(with_filter, without, strict=True)
    return np.array([np.nan if f is None or m is None else of(f) / of(m) for f, m in pairs])


def _equal_at(kappa: float, ratios: Array) -> float:
    """Return the Gamma r^2 at which the filter does not change the delay margin, which is the last crossing of the scan,
    refined."""
    from scipy.optimize import brentq

    k = int(np.flatnonzero((ratios[:-1] < 1) & (ratios[1:] >= 1))[-1])
    filtered, plain = loop(kappa), loop(None)

    def change(exponent: float) -> float:
        return float(np.log(margins(filtered(10**exponent)).delay / margins(plain(10**exponent)).delay))

    return float(10 ** brentq(change, np.log10(GAINS[k]), np.log10(GAINS[k + 1]), rtol=1e-6))
