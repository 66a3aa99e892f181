"""Tests which sampled schemes tolerate lost measurements. In Section V's case a tenth are lost, one by one or in bursts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from barbalat.controllers import Adrc, KnownParameters, L1PiecewiseConstant, Mrac, Sampled
from barbalat.design import pi_feedback
from barbalat.linear.systems import input_filter
from barbalat.papers.claim import Claim, Listing, Measurement, short, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.linear.linear_design import PI_DELAY
from barbalat.papers.jafari_2013.section_v import figures
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.papers.jafari_2013.statements import MENDED
from barbalat.problem.faults import Dropout
from barbalat.protocols import Controller
from barbalat.validate import Array

SAMPLE_TIME, T_END = 1e-3, 20.0
LOST_SHARE, BURST_SAMPLES = 0.1, 10
TOLERATED = 2.0
"""A scheme tolerates losses if no component's largest error exceeds this multiple of the error without losses."""
DRAWS, MORE_DRAWS = 12, 64
"""Number of draws of each kind of losses."""


@dataclass(frozen=True, eq=False)
class Losses:
    """The largest |e| of one scheme over the run: ``own`` (n,) without losses, ``singles`` and ``bursts`` (draws, n) with
    them."""

    own: Array
    singles: Array
    bursts: Array

    @property
    def factors(self) -> tuple[float, float]:
        """The factors by which the worst component of the worst draw exceeds its error without losses, for losses one by one and
        in bursts; infinite if a run is lost."""
        one_by_one, in_bursts = (
            float(np.nan_to_num(errors / self.own, nan=np.inf).max()) for errors in (self.singles, self.bursts)
        )
        return one_by_one, in_bursts

    @property
    def tolerated(self) -> bool:
        """Whether the scheme tolerates both kinds of losses in every draw."""
        return max(self.factors) <= TOLERATED

    @property
    def largest(self) -> float:
        """The largest |e_i| with losses; infinite if a run is lost."""
        return float(np.nan_to_num(np.vstack([self.singles, self.bursts]), nan=np.inf).max())


def schemes() -> list[Controller]:
    """Return the sampled schemes: the unchanged ones of the bundled case, and further ones with the bandwidth 1/kappa or with the
    ledger's PI design."""
    given = section_v.problem()
    continuous = (
        Mrac(gamma=1.0, name="MRAC"),
        section_v.robust_mrac("robust MRAC"),
        section_v.l1("L1-AC", 1e4),
        Adrc(bandwidth=1 / section_v.KAPPA, name="ADRC"),
        pi_feedback(given.known, unmodelled_delay=PI_DELAY, name="PI"),
    )
    ideal = KnownParameters(given.parameters, name="known parameters")  # it has no states, so any discretization is exact
    return [
        *(Sampled(controller=one, sample_time=SAMPLE_TIME) for one in continuous),
        L1PiecewiseConstant(sample_time=SAMPLE_TIME, filter=input_filter(section_v.KAPPA), name="piecewise-constant L1"),
        Sampled(controller=ideal, sample_time=SAMPLE_TIME, discretization="euler"),
    ]


def claim(draws: int = DRAWS) -> Claim:
    """Run every scheme with the same draws, and judge them by the largest error of each component."""
    found = {one.name: losses(one, draws) for one in schemes()}
    return judged({name: whole for name, (whole, _) in found.items()}, {name: tail for name, (_, tail) in found.items()})


def losses(controller: Controller, draws: int) -> tuple[Losses, Losses]:
    """Return the errors of the whole run, and those of its last quarter."""
    own = _errors(controller, [None])
    singles = _errors(controller, [Dropout(share=LOST_SHARE, seed=seed) for seed in range(draws)])
    burst = BURST_SAMPLES * SAMPLE_TIME
    bursts = _errors(controller, [Dropout(share=LOST_SHARE, burst=burst, seed=seed) for seed in range(draws)])
    whole, tail = (Losses(own[k][0], singles[k], bursts[k]) for k in range(2))
    return whole, tail


def _errors(controller: Controller, faults: Sequence[Dropout | None]) -> tuple[Array, Array]:
    """Return max |e| (runs, n) of each run and of its tail. Runs with different losses have different signals and cannot form an
    ensemble."""
    given = section_v.problem()
    problems = [given if fault is None else replace(given, faults=(fault,)) for fault in faults]
    runs = [figures([(problem, controller)], T_END, SAMPLE_TIME) for problem in problems]
    return np.vstack([run.max_abs_e for run in runs]), np.vstack([run.tail_max_abs_e for run in runs])


def judged(whole: Mapping[str, Losses], tail: Mapping[str, Losses]) -> Claim:
    """Return the row from the measurements of each scheme, over the run and over its tail."""
    sentence, draws = SENTENCES["missed-samples"], len(next(iter(whole.values())).singles)
    factors = [{name: one.factors[k] for name, one in whole.items()} for k in range(2)]
    one_by_one, in_bursts = (_worst(kind) for kind in factors)
    enlarged = [name for name, one in whole.items() if not one.tolerated]
    said = f"more than {TOLERATED:g} times with {', '.join(enlarged) or 'no scheme'}"
    return Claim(
        sentence=sentence,
        readings=(
            *(
                sentence.reads(max(kind.values()) <= TOLERATED, f"the largest factor is {_worst(kind)}; beyond {TOLERATED:g}: "
                f"{_beyond(kind)}", part)
                for part, kind in enumerate(factors)
            ),
            _in_the_tail(tail),
            _no_merit(whole),
        ),
        shows=f"In {draws} draws |e| grows by factors of up to {short(max(factors[0].values()))} if a tenth of the samples is "
        f"lost one by one and up to {short(max(factors[1].values()))} in bursts; {said}.",
        measured=f"the largest |e| becomes at most {one_by_one} as large if samples are lost one by one and at most {in_bursts} "
        f"as large if they are lost in bursts of {BURST_SAMPLES} samples; {said}. Each factor is relative to the same scheme's "
        "error without losses",
        how=f"Section V, T = {SAMPLE_TIME:g} s, no shell, {T_END:g} s, RK4, one step per sample; {draws} draws of each kind, "
        f"common to all schemes; MRAC with Gamma = 1, L1-AC with Gamma = 1e4, the robust MRAC of Figure 2 with {MENDED}, kappa = "
        f"{section_v.KAPPA:g} s, ADRC with the bandwidth 1/kappa, and the PI of l1-against-pi",
        listings=(_listing(whole, tail),),
        would_change="fails: an error that more than doubles when samples are lost one by one; holds: no error that more than "
        "doubles with bursts",
        sharpened=f"{MORE_DRAWS} draws of each kind instead of {DRAWS}, for which bursts also more than double the PI's error",
    )  # fmt: skip


def _worst(factors: Mapping[str, float]) -> str:
    name = max(factors, key=lambda one: factors[one])
    return f"{short(factors[name])} times ({name})"


def _beyond(factors: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {short(factor)}" for name, factor in factors.items() if factor > TOLERATED) or "no scheme"


def _in_the_tail(tail: Mapping[str, Losses]) -> Reading:
    """Return the reading on the tail, because the error of the transient hides the effect of later losses."""
    factors = {name: max(one.factors) for name, one in tail.items()}
    return Reading(
        "judged only by the error of the last quarter, every scheme tolerates both kinds of losses",
        max(factors.values()) <= TOLERATED,
        f"the largest factor is {_worst(factors)}; beyond {TOLERATED:g}: {_beyond(factors)}",
        "beside",
    )


def _no_merit(whole: Mapping[str, Losses]) -> Reading:
    """Return the reading on the absolute error, because each factor is relative to the scheme's own error."""
    least = min(whole, key=lambda one: max(whole[one].factors))
    smaller = [name for name, one in whole.items() if one.largest < whole[least].largest]
    return Reading(
        "the scheme with the smallest factor also has the smallest error when samples are lost",
        not smaller,
        f"{least}: |e| is up to {short(whole[least].largest)} with losses; {len(smaller)} of the {len(whole) - 1} others have a "
        "smaller error",
        "beside",
    )


def _listing(whole: Mapping[str, Losses], tail: Mapping[str, Losses]) -> Listing:
    return table(
        "The largest error without losses, the factors with a tenth lost, and the losses that are tolerated",
        {
            "scheme": list(whole),
            "max |e| without losses": [float(one.own.max()) for one in whole.values()],
            "one by one": [one.factors[0] for one in whole.values()],
            "in bursts": [one.factors[1] for one in whole.values()],
            "in bursts, last quarter": [one.factors[1] for one in tail.values()],
            "max |e| with losses": [one.largest for one in whole.values()],
            "tolerated": ["yes" if one.tolerated else "no" for one in whole.values()],
        },
    )


ROWS = (
    Measurement(
        claim,
        2.5,
        {"missed-samples": "which schemes tolerate missed samples"},
        place=205,
        sharper=partial(claim, MORE_DRAWS),
        sharper_seconds=8.0,
    ),
)
