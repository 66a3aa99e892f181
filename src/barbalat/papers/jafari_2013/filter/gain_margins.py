"""The effect of the gain on the exact margins of the adapting loop around constant commands, with and without the filter."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from barbalat.certificates.linear_loops.ideal import fast_adaptation
from barbalat.linear.margins import margins
from barbalat.linear.systems import input_filter
from barbalat.papers.claim import Chart, ChartAxis, Claim, Curve, Measurement, span, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.filter.adapting_margins import (
    COMMAND_CREST,
    DOWNWARDS,
    GAINS,
    MARGINS,
    METHOD,
    UPWARDS,
    loop,
    scan,
    tolerates,
)
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.validate import Array

SHOWN_KAPPAS = (0.005, section_v.KAPPA, 0.05)
"""The filters of the chart."""


def gain_reduces_margins() -> Claim:
    """Compute every margin over Gamma, with and without the filter, and draw the delay margin."""
    curves = {"MRAC": _over_gains("delay margin", None)}
    curves |= {f"L1-AC, κ = {kappa:g} s": _over_gains("delay margin", kappa) for kappa in SHOWN_KAPPAS}
    plain, filtered = curves["MRAC"], curves[f"L1-AC, κ = {section_v.KAPPA:g} s"]
    lowest, C = int(filtered.argmin()), input_filter(section_v.KAPPA).realise()
    limit = margins(fast_adaptation(section_v.problem().plant, C)).delay
    back = int(np.flatnonzero(filtered < limit / 2)[-1]) + 1
    slope = np.log(plain[-1] / plain[-4]) / np.log(GAINS[-1] / GAINS[-4])
    chart = Chart(
        key="delay-margin-gain",
        title="The delay margin of the adapting loop, against the gain",
        caption=(
            "Exact margins of the loops linearised around a constant command r, including the law, with Section V's plant; they "
            "depend only on Γr². With the filter the margin falls as long as the resonance of the adaptation crosses |L| = 1. "
            "After that the margin returns to the limit of fast adaptation, near 1.6 κ here."
        ),
        x=ChartAxis("Γr²", GAINS, logarithmic=True),
        quantity="delay margin [s]",
        curves=tuple(Curve(label, GAINS, values) for label, values in curves.items()),
    )
    schemes = {"MRAC": None, f"L1-AC, kappa = {section_v.KAPPA:g} s": section_v.KAPPA}
    found = {(who, name): _over_gains(name, kappa) for who, kappa in schemes.items() for name in MARGINS}
    sentence, section_vs = SENTENCES["gain-reduces-margins"], {who: at_section_v(kappa) for who, kappa in schemes.items()}
    of_mrac, of_l1 = section_vs.values()
    literal = sentence.reads(all(_smaller(values) for values in of_mrac.values()), _from_to(of_mrac))
    beside = (
        Reading(
            f"L1-AC with Section V's filter: both are more than a tenth smaller at Section V's gain than at "
            f"{section_v.MODERATE_GAIN:g}",
            all(_smaller(values) for values in of_l1.values()),
            _from_to(of_l1),
            "beside",
        ),
        *(_ends(who, {name: found[who, name] for name in OWN_MEASURES}) for who in schemes),
        *(_reading(who, name, values) for (who, name), values in found.items()),
    )
    of_plain, of_filtered = of_mrac["delay margin"], of_l1["delay margin"]
    falls_of_mrac, falls_of_l1 = ([name for name in MARGINS if _falls(found[who, name])] for who in schemes)
    return Claim(
        sentence=sentence,
        readings=(literal, *beside),
        shows=f"From Gamma = {section_v.MODERATE_GAIN:g} to {HIGH_GAIN:g} MRAC's delay margin goes from {of_plain[0]:.2g} to "
        f"{of_plain[1]:.2g} s; L1-AC's is {'unchanged' if _unchanged(of_filtered) else 'changed'}, {of_filtered[0]:.4g} to "
        f"{of_filtered[1]:.4g} s, and {filtered[0]:.2g} s with slow adaptation.",
        measured=f"these margins fall with every increase of the gain: the {_listed(falls_of_mrac)} of MRAC; the "
        f"{_listed(falls_of_l1)} of L1-AC. Over {len(GAINS)} values of Gamma r^2 from {GAINS[0]:g} to {GAINS[-1]:g} MRAC's delay "
        f"margin goes from {plain[0]:.3g} s to {plain[-1]:.2g} s, at the end in proportion to Gamma^{slope:.2f}. L1-AC's (kappa "
        f"= {section_v.KAPPA:g} s) is not monotone: it falls from {filtered[0]:.3g} s to {filtered[lowest]:.2g} s at Gamma r^2 = "
        f"{GAINS[lowest]:.2g}, is at least {filtered[back:].min():.3g} s above {GAINS[back]:.2g}, and tends to {limit:.3g} s",
        how=f"{METHOD}; the literal readings use Gamma = {section_v.MODERATE_GAIN:g}, as in smaller-gain, and {HIGH_GAIN:g}, "
            f"around r = {COMMAND_CREST:g}, the crest of Section V's command. A margin that changes by less than a tenth counts "
            f"as unchanged",
        maps=(chart,),
        would_change="an MRAC for which one of the two margins is not smaller at a high gain. L1-AC's margins are smaller too "
        "if the lowest gain of the sweep is taken as the moderate gain",
    )  # fmt: skip


UNCHANGED_SHARE = 0.1
"""A margin whose relative change is less than this counts as unchanged."""
HIGH_GAIN = 1e4
"""Section V's "very large adaptive gain"."""


def _smaller(values: Array) -> bool:
    """True if the last value is smaller than the first by more than ``UNCHANGED_SHARE``."""
    return bool(values[-1] < (1 - UNCHANGED_SHARE) * values[0])


def _unchanged(values: Array) -> bool:
    return bool(abs(values[-1] / values[0] - 1) <= UNCHANGED_SHARE)


def at_section_v(kappa: float | None) -> dict[str, Array]:
    """Return each of ``OWN_MEASURES`` at the moderate gain and at Section V's, around the command's crest."""
    at = loop(kappa)
    tolerated = [tolerates(at(gamma * COMMAND_CREST**2)) for gamma in (section_v.MODERATE_GAIN, HIGH_GAIN)]
    moderate, high = (one for one in tolerated if one is not None)  # the loops are stable
    return {name: np.array([MARGINS[name](moderate), MARGINS[name](high)]) for name in OWN_MEASURES}


def _from_to(margins_of: Mapping[str, Array]) -> str:
    return "; ".join(f"{name} {values[0]:.4g} to {values[-1]:.4g}" for name, values in margins_of.items())


def _ends(who: str, margins_of: Mapping[str, Array]) -> Reading:
    """Return a supplementary reading that compares the highest gain of the sweep with the lowest."""
    return Reading(
        f"{who}: both margins are smaller at the highest gain of the sweep, Gamma r^2 = {GAINS[-1]:g}, than at the lowest, "
        f"{GAINS[0]:g}",
        all(_smaller(values) for values in margins_of.values()),
        _from_to(margins_of),
        "beside",
    )


OWN_MEASURES = ("delay margin", "small-gain margin 1/||T||_inf")
"""The two ``MARGINS`` by which the paper expresses robustness: the size of Delta_m in (11), and its example, a delay."""


def l1_margins() -> Claim:
    """Test the statements of L1's authors on phase and delay margins for a different class of plants on Section V's plant."""
    sentence = SENTENCES["l1-margins"]
    phase, delay = (_over_gains(name, section_v.KAPPA) for name in ("phase margin", "delay margin"))
    plain = _over_gains("delay margin", None)
    decade = delay[GAINS[-1] / 10.001 <= GAINS]
    C = input_filter(section_v.KAPPA).realise()
    limit = margins(fast_adaptation(section_v.problem().plant, C)).delay
    readings = (
        sentence.reads(bool(phase.max() < phase.min() * 1.1), _told({"phase margin": phase})),
        sentence.reads(
            bool(decade.min() > 0 and decade.max() < decade.min() * 1.1), f"{span(decade)} s over the last decade, {limit:.4g} "
            f"s in the limit of fast adaptation", 1
        ),
        Reading("MRAC's delay margin goes to zero", _falls(plain), f"{plain[0]:.3g} s to {plain[-1]:.2g} s", "beside"),
    )  # fmt: skip
    at = [0, int(phase.argmin()), len(GAINS) - 1]
    return Claim(
        sentence=sentence,
        readings=readings,
        shows=f"L1-AC's delay margin goes from {delay[0]:.2g} s down to {delay.min():.3g} s and back up to {delay[-1]:.4f} s "
        f"(MRAC: {plain[-1]:.0e} s), its phase margin "
        f"from {' to '.join(f'{phase[i]:.2g}' for i in at)} rad.",
        measured=f"over Gamma r^2 from {GAINS[0]:g} to {GAINS[-1]:g} L1-AC's delay margin is {span(delay)} s. It is smallest at "
        f"{GAINS[int(delay.argmin())]:.2g} and then rises again to {delay[-1]:.4g} s. Its phase margin is {phase[at[0]]:.3g} rad "
        f"at the lowest gain, {phase[at[1]]:.3g} rad at {GAINS[at[1]]:.2g} and {phase[-1]:.3g} rad at the highest",
        how=f"{METHOD}; kappa = {section_v.KAPPA:g} s. L1's authors treat a linear plant under a constant disturbance, which "
        f"reproduce cao_2006 measures",
        listings=(
            table(
                "L1-AC's exact phase and delay margins against the gain, and MRAC's delay margin",
                {"Gamma r^2": GAINS[::3], "phase [rad]": phase[::3], "delay [s]": delay[::3], "MRAC, delay [s]": plain[::3]},
            ),
        ),
        would_change="a different plant or filter; a break point of the loop other than the plant input",
    )  # fmt: skip


def _told(found: Mapping[str, Array]) -> str:
    said = []
    for name, values in found.items():
        least = int(values.argmin())
        between = f", least {values[least]:.2g} at Gamma r^2 = {GAINS[least]:.2g}" if 0 < least < len(values) - 1 else ""
        said.append(f"{name} {values[0]:.3g} at the smallest gain{between} and {values[-1]:.2g} at the largest")
    return "; ".join(said)


def _over_gains(name: str, kappa: float | None) -> Array:
    """Return one of ``MARGINS`` over ``GAINS``, NaN if the loop is unstable."""
    return np.array([np.nan if tolerated is None else MARGINS[name](tolerated) for tolerated in scan(kappa)])


def _falls(values: Array) -> bool:
    return bool((np.diff(values) < 0).all())


def _reading(who: str, name: str, values: Array) -> Reading:
    """Return the supplementary reading that a margin falls with every increase of the gain, which the sentence does not
    say."""
    of_k = "; the gain margins are stated as the distance of the factor k from 1" if name in (UPWARDS, DOWNWARDS) else ""
    return Reading(
        f"{who}: the {name} falls with every increase of the gain", _falls(values), _told({name: values}) + of_k, "beside"
    )


def _listed(names: list[str]) -> str:
    return ", ".join(names) or "none"


ROWS = (
    Measurement(
        gain_reduces_margins, 0.7, {"gain-reduces-margins": "a high adaptive gain reduces robustness"}, place=210, shares="scans"
    ),
    Measurement(
        l1_margins, 0.2, {"l1-margins": "L1-AC's phase and delay margins on Section V's plant"}, place=212, shares="scans"
    ),
)
