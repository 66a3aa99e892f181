"""What the gain does to the exact margins of the loop that adapts, with and without the filter, around constant commands."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from barbalat.certificates.linear_loops.ideal import fast_adaptation
from barbalat.controllers import Mrac
from barbalat.linear.margins import margins
from barbalat.linear.systems import input_filter
from barbalat.papers.claim import Chart, ChartAxis, Claim, Curve, Measurement, span, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.filter.adapting_margins import DOWNWARDS, FIGURE_3_GAIN, GAINS, MARGINS, METHOD, UPWARDS, scan
from barbalat.papers.jafari_2013.section_v import figures
from barbalat.papers.jafari_2013.sentences import SENTENCES
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
    sentence = SENTENCES["gain-reduces-margins"]
    literal = tuple(
        sentence.reads(all(_falls(found[who, name]) for name in OWN_MEASURES), _told({name: found[who, name] for name in OWN_MEASURES}), part)
        for part, who in enumerate(schemes)
    )  # fmt: skip
    beside = tuple(_reading(who, name, values) for (who, name), values in found.items() if name not in OWN_MEASURES)
    of_mrac, of_l1 = ([name for name in MARGINS if _falls(found[who, name])] for who in schemes)
    return Claim(
        sentence=sentence,
        readings=(*literal, *beside),
        shows=f"Delay margin over the gain: MRAC {plain[0]:.2g} s to {plain[-1]:.1g} s; L1-AC {filtered[0]:.2g} s, least {filtered[lowest]:.1g} s, at last {limit:.2g} s.",
        measured=f"falls at every step of the gain: of MRAC's margins the {_listed(of_mrac)}; of L1-AC's the {_listed(of_l1)}. Delay margin over {len(GAINS)} values of Gamma r^2 from {GAINS[0]:g} to {GAINS[-1]:g}: true of MRAC at every step, {plain[0]:.3g} s to {plain[-1]:.2g} s, at last as "
        f"Gamma^{slope:.2f}. L1-AC (kappa = {section_v.KAPPA:g} s) is not monotone: {filtered[0]:.3g} s falls to {filtered[lowest]:.2g} s at Gamma r^2 = {GAINS[lowest]:.2g}, "
        f"from {GAINS[back]:.2g} on it is at least {filtered[back:].min():.3g} s, and tends to {limit:.3g} s",
        how=METHOD,
        maps=(chart,),
        would_change="holds: an L1-AC whose delay margin falls with every rise of the gain; fails: an MRAC of which one of the two does not",
    )  # fmt: skip


OWN_MEASURES = ("delay margin", "small-gain margin 1/||T||_inf")
"""Of ``MARGINS``: the size of the Delta_m of (11), in which the paper states robustness, and its example, a delay."""


def l1_margins() -> Claim:
    """What the other side says of L1-AC's phase and delay margins, on Section V's plant."""
    sentence = SENTENCES["l1-margins"]
    phase, delay = (_over_gains(name, section_v.KAPPA) for name in ("phase margin", "delay margin"))
    plain = _over_gains("delay margin", None)
    decade = delay[GAINS[-1] / 10.001 <= GAINS]
    C = input_filter(section_v.KAPPA).realise()
    limit = margins(fast_adaptation(section_v.problem().plant, C)).delay
    readings = (
        sentence.reads(bool(phase.max() < phase.min() * 1.1), _told({"phase margin": phase})),
        sentence.reads(
            bool(decade.min() > 0 and decade.max() < decade.min() * 1.1), f"{span(decade)} s over the last decade, {limit:.4g} s in the limit of fast adaptation", 1
        ),
        Reading("the MRAC's delay margin, on the contrary, goes to zero", _falls(plain), f"{plain[0]:.3g} s to {plain[-1]:.2g} s", "beside"),
    )  # fmt: skip
    at = [0, int(phase.argmin()), len(GAINS) - 1]
    return Claim(
        sentence=sentence,
        readings=readings,
        shows=f"At the highest gain the delay margin is {delay[-1]:.3g} s with the filter, {plain[-1]:.1g} s without; the phase margin goes "
        f"{', '.join(f'{phase[i]:.2g}' for i in at)} rad.",
        measured=f"over Gamma r^2 from {GAINS[0]:g} to {GAINS[-1]:g} L1-AC's delay margin is {span(delay)} s, from {GAINS[int(delay.argmin())]:.2g}, where it is least, it rises again to "
        f"{delay[-1]:.4g} s; its phase margin is {phase[at[0]]:.3g} rad at the lowest gain, {phase[at[1]]:.3g} rad at {GAINS[at[1]]:.2g}, {phase[-1]:.3g} rad at the highest",
        how=f"{METHOD}; kappa = {section_v.KAPPA:g} s. The paper quoted treats another plant, a linear one under a constant disturbance",
        listings=(
            table(
                "L1-AC's exact phase and delay margins over the gain, and MRAC's delay margin",
                {"Gamma r^2": GAINS[::3], "phase [rad]": phase[::3], "delay [s]": delay[::3], "MRAC, delay [s]": plain[::3]},
            ),
        ),
        would_change="another plant or filter; another break point of the loop than the plant's input",
    )  # fmt: skip


def no_advantage() -> Claim:
    """L1-AC and the MRAC of the same gain, in each margin, in tracking and in the control that leaves the controller."""
    sentence = SENTENCES["no-advantage"]
    place = int(np.argmin(np.abs(np.log(GAINS / FIGURE_3_GAIN))))
    better, columns = [], {}
    for name in MARGINS:
        without, filtered = (_over_gains(name, kappa)[place] for kappa in (None, section_v.KAPPA))
        columns[name] = (without, filtered)
        if filtered > without:
            better.append(f"{name} {without:.2g} to {filtered:.3g}")
    gamma = section_v.MODERATE_GAIN
    schemes = Mrac(gamma=gamma), section_v.l1("L1", gamma)
    tails = [float(figures([(section_v.problem(), one)], 60.0, 1e-4).tail_max_abs_e.max()) for one in schemes]
    delay = columns["delay margin"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(not better and tails[1] > tails[0], f"at Gamma r^2 = {GAINS[place]:.2g}, Figure 3's, higher with the filter: {', '.join(better) or 'none'}"),
            Reading("of the tail's error, at a gain that the step resolves", tails[1] > tails[0], f"{tails[0]:.2g} without the filter, {tails[1]:.3g} with it", "beside"),
        ),
        shows=f"At Figure 3's gain the delay margin is {delay[0]:.1g} s without the filter and {delay[1]:.2g} s with it; tail error {tails[0]:.0e} and {tails[1]:.2g}.",
        measured=f"higher with the filter at Figure 3's gain: {', '.join(better) or 'none'}; of {len(MARGINS)} margins. The tail's error at Gamma = {gamma:g} is {tails[0]:.2g} without the filter and {tails[1]:.3g} with it",
        how=f"{METHOD}, the gain of the scan that is nearest to Figure 3's; the error: RK4, h = 1e-4 s, 60 s, no modelling error",
        listings=(
            table(
                f"Exact margins at Gamma r^2 = {GAINS[place]:.2g}; of the factors k what is between them and 1",
                {"margin": list(columns), "MRAC": [one for one, _ in columns.values()], "L1-AC": [other for _, other in columns.values()]},
            ),
        ),
        would_change="margins that are all lower with the filter at this gain. That a smaller gain or the robust MRAC does as well is another sentence: smaller-gain, robust-mrac-better",
    )  # fmt: skip


def _told(found: Mapping[str, Array]) -> str:
    said = []
    for name, values in found.items():
        least = int(values.argmin())
        between = f", least {values[least]:.2g} at Gamma r^2 = {GAINS[least]:.2g}" if 0 < least < len(values) - 1 else ""
        said.append(f"{name} {values[0]:.3g} at the smallest gain{between}, {values[-1]:.2g} at the largest")
    return "; ".join(said)


def _over_gains(name: str, kappa: float | None) -> Array:
    """One of ``MARGINS`` over ``GAINS``; NaN where the loop is unstable."""
    return np.array([np.nan if borne is None else MARGINS[name](borne) for borne in scan(kappa)])


def _falls(values: Array) -> bool:
    return bool((np.diff(values) < 0).all())


def _reading(who: str, name: str, values: Array) -> Reading:
    """Another margin falls at every step of the gain: beside the sentence."""
    of_k = "; of the factor k what is between it and 1" if name in (UPWARDS, DOWNWARDS) else ""
    return Reading(f"{who}: {name}", _falls(values), _told({name: values}) + of_k, "beside")


def _listed(names: list[str]) -> str:
    return ", ".join(names) or "none"


ROWS = (
    Measurement(
        gain_reduces_margins, 0.7, {"gain-reduces-margins": "a high adaptive gain reduces robustness"}, place=210, shares="scans"
    ),
    Measurement(
        l1_margins, 0.2, {"l1-margins": "what L1's authors say of its phase and delay margins"}, place=212, shares="scans"
    ),
    Measurement(no_advantage, 0.3, {"no-advantage": "the filter brings no advantage"}, place=214, shares="scans"),
)
