"""What the gain does to the exact margins of the loop that adapts, with and without the filter, around constant commands."""

from __future__ import annotations

import numpy as np

from barbalat.certificates.linear_loops.ideal import fast_adaptation
from barbalat.linear.margins import margins
from barbalat.linear.systems import input_filter
from barbalat.papers.claim import Chart, ChartAxis, Claim, Curve, Measurement, Reading, of_readings, verdict
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.filter.adapting_margins import DOWNWARDS, GAINS, MARGINS, METHOD, UPWARDS, scan
from barbalat.validate import Array

SHOWN_KAPPAS = (0.005, section_v.KAPPA, 0.05)
"""The filters of the chart."""


def gain_reduces_margins() -> Claim:
    """Every margin over Gamma, with and without the filter; the delay margin is drawn."""
    curves = {"MRAC": _over_gains("delay margin", None)}
    curves |= {f"L1-AC, κ = {kappa:g} s": _over_gains("delay margin", kappa) for kappa in SHOWN_KAPPAS}
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
        x=ChartAxis("Γr²", GAINS, logarithmic=True),
        quantity="delay margin [s]",
        curves=tuple(Curve(label, GAINS, values) for label, values in curves.items()),
    )
    schemes = {"MRAC": None, f"L1-AC, kappa = {section_v.KAPPA:g} s": section_v.KAPPA}
    found = {(who, name): _over_gains(name, kappa) for who, kappa in schemes.items() for name in MARGINS}
    readings = tuple(_reading(who, name, values) for (who, name), values in found.items())
    of_mrac, of_l1 = ([name for name in MARGINS if _falls(found[who, name])] for who in schemes)
    return Claim(
        "gain-reduces-margins", "Section III.A, last paragraph; Section III.B, last paragraph", "A high adaptive gain reduces robustness",
        of_readings(readings),
        f"falls at every step of the gain: of MRAC's margins the {_listed(of_mrac)}; of L1-AC's the {_listed(of_l1)}. Delay margin over {len(GAINS)} values of Gamma r^2 from {GAINS[0]:g} to {GAINS[-1]:g}: true of MRAC at every step, {plain[0]:.3g} s to {plain[-1]:.2g} s, at last as "
        f"Gamma^{slope:.2f}. L1-AC (kappa = {section_v.KAPPA:g} s) is not monotone: {filtered[0]:.3g} s falls to {filtered[lowest]:.2g} s at Gamma r^2 = {GAINS[lowest]:.2g}, "
        f"from {GAINS[back]:.2g} on it is at least {filtered[back:].min():.3g} s, and tends to {limit:.3g} s",
        METHOD,
        maps=(chart,),
        number=f"delay margin of MRAC goes at last as Gamma^{slope:.2f}",
        readings=readings,
        condition=f"read of MRAC's {_listed(of_mrac)}; with the filter at every gain of the {_listed(of_l1)} alone, of the others up to a gain of their own at most",
        would_change="confirmed: margins of either scheme that all fall with the gain; not confirmed: an MRAC of which none does",
    )  # fmt: skip


def _over_gains(name: str, kappa: float | None) -> Array:
    """One of ``MARGINS`` over ``GAINS``; NaN where the loop is unstable."""
    return np.array([np.nan if borne is None else MARGINS[name](borne) for borne in scan(kappa)])


def _falls(values: Array) -> bool:
    return bool((np.diff(values) < 0).all())


def _reading(who: str, name: str, values: Array) -> Reading:
    """Return the reading that the margin falls at every step of the gain."""
    least = int(values.argmin())
    between = f", at its least {values[least]:.2g} at Gamma r^2 = {GAINS[least]:.2g}" if 0 < least < len(values) - 1 else ""
    said = f"{values[0]:.3g} at the smallest gain{between}, {values[-1]:.2g} at the largest"
    if name in (UPWARDS, DOWNWARDS):
        said += "; of the factor k what is between it and 1"
    return Reading(f"{who}: {name}", verdict(holds=_falls(values)), said)


def _listed(names: list[str]) -> str:
    return ", ".join(names) or "none"


ROWS = (
    Measurement(
        gain_reduces_margins, 0.7, {"gain-reduces-margins": "a high adaptive gain reduces robustness"}, place=210, shares="scans"
    ),
)
