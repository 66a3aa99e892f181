"""The filter's effect on the oscillations in the control, by their frequency and size with and without C."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from barbalat.controllers import Mrac
from barbalat.papers.claim import Claim, Listing, Measurement, span, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.run.engine.simulate import simulate
from barbalat.run.results.result import Result
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

SLOWEST_OSCILLATION = 100.0
"""Smallest frequency of an oscillation [rad/s]. The command, the model and the projected estimates move below 10 rad/s, and the
slowest ringing considered is near 900 rad/s."""
RECORDED_INSTANTS = 100_000
"""Number of recorded instants of a run: every step of the coarse runs and every fifth step of the fine ones, which still
resolves their ringing."""
SEGMENT_INSTANTS = 8192
"""Number of instants of one periodogram of Welch's method. It resolves a hundredth of the frequencies found."""
NUMERICAL_SETTINGS = {1e-4: (3e3, 1e4, 1e5)}
"""Steps [s] and gains at which RK4 is unstable; the second is Figure 3's."""
MORE_NUMERICAL_SETTINGS = {2e-4: (1e3, 3e3, 1e4, 1e5), 1e-4: (3e3, 1e4, 1e5, 1e6), 5e-5: (1e4, 3e4, 1e5)}
RESOLVED_SETTINGS, MORE_RESOLVED_SETTINGS = {1e-5: (100.0,)}, {1e-5: (10.0, 100.0, 1000.0)}
"""Settings with h omega_a below 0.1, so the ringing is that of the equations."""
FIGURE_3 = (section_v.COARSE_STEP, 1e4)
EQUAL_FREQUENCY_SHARE = 0.1
"""Two mean frequencies within this fraction count as equal, because the frequency varies by as much from one quarter of a run to
the next."""


class Oscillation(NamedTuple):
    """The oscillation of u above SLOWEST_OSCILLATION, in the second half of a run."""

    mean: float  # mean of the frequency, weighted by the power [rad/s]
    peak: float  # frequency of the largest power density [rad/s]
    rms: float  # unit of u


class Pair(NamedTuple):
    """The oscillations at one step and gain, without and with C."""

    h: float
    gamma: float
    without: Oscillation
    filtered: Oscillation

    @property
    def frequency(self) -> float:
        """The ratio of the mean frequencies of the filtered and the unfiltered control."""
        return self.filtered.mean / self.without.mean

    @property
    def size(self) -> float:
        """The ratio of the RMS values of the oscillations."""
        return self.filtered.rms / self.without.rms


def oscillation(t: Array, u: Array) -> Oscillation:
    """Measure the oscillation by Welch's method. Both arrays are (K,), with evenly spaced instants."""
    from scipy.signal import detrend, welch

    late = t > t[-1] / 2
    f, power = welch(u[late], fs=1 / (t[1] - t[0]), nperseg=SEGMENT_INSTANTS, detrend=detrend)
    above = 2 * np.pi * f > SLOWEST_OSCILLATION
    w, power = 2 * np.pi * f[above], power[above]
    return Oscillation(
        float(w @ power / power.sum()), float(w[power.argmax()]), float(np.sqrt(np.trapezoid(power, w / (2 * np.pi))))
    )


def measured(chosen: Mapping[float, tuple[float, ...]]) -> list[Pair]:
    """Simulate both schemes at each step and gain. The record, of every step or every fifth, limits the length of the runs."""
    found = []
    for h, gains in chosen.items():
        simulation = Simulation(t_end=RECORDED_INSTANTS * max(h, 5e-5), dt=h, record_points=RECORDED_INSTANTS)
        for gamma in gains:
            runs = simulate(section_v.problem(), [Mrac(gamma=gamma, name="without"), section_v.l1("filtered", gamma)], simulation)
            found.append(Pair(h, gamma, _of(runs["without"]), _of(runs["filtered"])))
    return found


def _of(run: Result) -> Oscillation:
    return oscillation(run.t, run.u)


def claim(*, full: bool = False) -> Claim:
    """Measure the numerical oscillations at and around Figure 3's setting, and the ringing of the equations."""
    numerical, resolved = (
        measured(MORE_NUMERICAL_SETTINGS if full else NUMERICAL_SETTINGS),
        measured(MORE_RESOLVED_SETTINGS if full else RESOLVED_SETTINGS),
    )
    shown = next(pair for pair in numerical if (pair.h, pair.gamma) == FIGURE_3)
    falls = [pair for pair in (*numerical, *resolved) if pair.frequency < 1 - EQUAL_FREQUENCY_SHARE]
    count = len(numerical) + len(resolved)
    return Claim(
        sentence=SENTENCES["filter-control-frequency"],
        readings=_readings(shown, numerical, resolved),
        shows=f"In Figure 3 the filter changes the mean frequency of u from {shown.without.mean:.0f} to "
        f"{shown.filtered.mean:.0f} rad/s and its strongest frequency from {shown.without.peak:.0f} to "
        f"{shown.filtered.peak:.0f}.",
        measured=f"at Figure 3's gain and step the filter changes the mean frequency of u above {SLOWEST_OSCILLATION:g} rad/s "
            f"from {shown.without.mean:.3g} to {shown.filtered.mean:.3g} rad/s, by a factor of {shown.frequency:.2f}. It falls "
            f"by more than a tenth in {len(falls)} of {count} settings. At Figure 3's settings the RMS value of the "
            f"oscillations is {shown.without.rms:.3g} without the filter and {shown.filtered.rms:.3g} with it",
        how=f"Section V, MRAC and L1-AC at the same Gamma, RK4, u at {RECORDED_INSTANTS} instants, second half of the run, "
            f"Welch's method; h and Gamma as listed. A difference below {EQUAL_FREQUENCY_SHARE:.0%} counts as none",
        listings=_listings(numerical, resolved),
        would_change="a different gain or step of the paper, or a different definition of the frequency of a signal that is not "
            "a sine",
        sharpened=f"also h = 2e-4 and 5e-5 s, and more gains, "
        f"{sum(map(len, MORE_NUMERICAL_SETTINGS.values())) + len(MORE_RESOLVED_SETTINGS[1e-5])} settings in all",
    )  # fmt: skip


def _readings(shown: Pair, numerical: list[Pair], resolved: list[Pair]) -> tuple[Reading, ...]:
    peaks = [pair.filtered.peak / pair.without.peak for pair in numerical]
    sizes, expected = [pair.size for pair in numerical], [1 / (section_v.KAPPA * pair.without.mean) for pair in numerical]
    ringing_peak = [pair.filtered.peak / pair.without.peak for pair in resolved]
    ringing, ringing_size = [pair.frequency for pair in resolved], [pair.size for pair in resolved]
    peak = shown.filtered.peak / shown.without.peak
    mean_falls = shown.frequency < 1 - EQUAL_FREQUENCY_SHARE
    mean = f"the mean goes from {shown.without.mean:.3g} to {shown.filtered.mean:.3g} rad/s, a factor of {shown.frequency:.2f}"
    return (
        SENTENCES["filter-control-frequency"].reads(mean_falls and peak < 1 - EQUAL_FREQUENCY_SHARE, f"{mean}; the strongest "
        f"frequency changes by a factor of {peak:.2f}"),
        Reading("the frequency is the mean weighted by power, at Figure 3's gain and step", mean_falls, mean),
        Reading("the frequency is that of the strongest component, at Figure 3's gain and "
        "step", peak < 1 - EQUAL_FREQUENCY_SHARE, f"it changes by a factor of {peak:.2f}"),
        Reading(
            "the mean frequency falls at every gain at which u oscillates",
            all(pair.frequency < 1 - EQUAL_FREQUENCY_SHARE for pair in numerical),
            f"the mean changes by factors of {span([pair.frequency for pair in numerical])} and the strongest frequency by "
            f"{span(peaks)}, in {len(numerical)} settings. Without the filter the strongest frequency is "
            f"{span([pair.without.peak * pair.h / (2 * np.pi) for pair in numerical])} cycles per step of the solver",
            "beside",
        ),
        Reading(
            "the ringing of the exact solution, resolved by the step, becomes slower",
            all(ratio < 1 - EQUAL_FREQUENCY_SHARE for ratio in ringing),
            f"the mean changes by factors of {span(ringing)} and the strongest frequency by {span(ringing_peak)}: the ringing "
            "has the frequency sqrt(Gamma b'P b) |x|, which does not depend on C",
            "beside",
        ),
        Reading(
            "the numerical oscillations in the control shrink to less than a tenth (the purpose of a low-pass filter)",
            all(size < 0.1 for size in sizes),
            f"the RMS value changes by factors of {span(sizes)}; 1/(kappa w) predicts {span(expected)}",
            "beside",
        ),
        Reading(
            "the ringing of the exact solution shrinks in the same way",
            all(size < 0.1 for size in ringing_size),
            f"the RMS value changes by factors of {span(ringing_size)} at Gamma = {span([pair.gamma for pair in resolved])}: "
            "without the filter u itself damps the ringing",
            "beside",
        ),
    )  # fmt: skip


def _listings(numerical: list[Pair], resolved: list[Pair]) -> tuple[Listing, ...]:
    pairs = (*numerical, *resolved)
    settings = {
        "whose": ["solver's"] * len(numerical) + ["equations'"] * len(resolved),
        "h [s]": [pair.h for pair in pairs],
        "Gamma": [pair.gamma for pair in pairs],
    }

    def compared(what: str, of: Callable[[Oscillation], float]) -> Listing:
        without, filtered = (
            np.array([of(one) for one in each]) for each in zip(*((p.without, p.filtered) for p in pairs), strict=True)
        )
        columns = {"without C": without, "with C": filtered, "ratio": filtered / without}
        return table(f"Oscillations in u above {SLOWEST_OSCILLATION:g} rad/s: {what}", settings | columns)

    return (
        compared("mean frequency [rad/s]", lambda one: one.mean),
        compared("strongest frequency [rad/s]", lambda one: one.peak),
        compared("RMS value", lambda one: one.rms),
    )


ROWS = (
    Measurement(
        claim,
        2.5,
        {"filter-control-frequency": "the filter's effect on the oscillations in the control"},
        place=320,
        sharper=partial(claim, full=True),
        sharper_seconds=7.5,
    ),
)
