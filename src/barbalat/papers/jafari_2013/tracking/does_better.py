"""Compares the robust MRAC with L1-AC. Both have the same number of tunings, drawn evenly over their parameters.

No setting is chosen by hand. A tuning is beaten if a tuning of the other side is worse in no objective and better in at least
one. The unbeaten tunings of a side reach results that the other side does not reach. The objectives are those of the paper that
apply to every tuning (the transient, the tracking error, and unmodelled dynamics in the form of an input delay), and a bounded
disturbance, which Section IV names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from barbalat.adaptation.law import Normalization
from barbalat.adaptation.laws import LeastSquares
from barbalat.controllers import L1Adaptive, RobustMrac
from barbalat.linear.systems import input_filter, two_slopes
from barbalat.papers.claim import Chart, ChartAxis, Claim, Curve, Listing, Measurement, short
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import figures, variant
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.papers.jafari_2013.statements import MENDED
from barbalat.papers.jafari_2013.tunings import Side, drawn, ranges
from barbalat.problem.actuation import PlantInput
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller, Signal
from barbalat.signals import Constant, Sine
from barbalat.solvers.simulation import Simulation
from barbalat.study.reference_motion import ReferenceMotion
from barbalat.validate import Array

BUDGET, MORE = 64, 256
"""Number of tunings of each side without and with ``--full``. Sobol's sequence is balanced for powers of two."""
TIMES = (2e-3, 0.5)
"""Range [s] of kappa and of tau, the same for both sides."""
L1_KNOBS = {"kappa": TIMES, "Gamma": (0.3, 300.0)}
"""Parameters of L1-AC, spaced evenly in their logarithms: the filter's time constant [s], and the gain, up to the largest one
that the step resolves. Half of the tunings have filter (6), the other half the second-order filter with two slopes of 1 - C."""
ROBUST_KNOBS = {"tau": TIMES, "P(0)": (1.0, 1e3), "alpha_0": (1e-3, 1.0), "delta_0": (0.05, 1.0)}
"""Parameters of the robust MRAC, also spaced evenly in their logarithms. 1/delta_0 is at least the largest tau."""
STEP = {"L1-AC": 1e-4, "robust MRAC": 5e-4}
"""Steps [s]. h omega_a is at most 1.2 for L1-AC; h/tau is at most 0.25 and h P(0) at most 0.5 for the robust MRAC."""
T_END, DELAYED_T_END = 60.0, 36.0
"""Horizon [s] of runs with a delay, three periods of the command."""
DISTURBANCES: dict[str, Signal | None] = {"no disturbance": None, "d = 20": Constant(20.0), "d = 20 sin 2t": Sine(20.0, 2.0)}
"""Amplitude of the disturbance, about a hundredth of the largest control."""
DELAYS = np.geomspace(2e-3, 1.0, 10)
"""Delays [s], each twice the previous one. The search finds the first delay with a tail error above a fifth of the model's
motion."""
HALVINGS = 3
"""Number of bisections between the last delay with which the loop follows the model and the first with which it does not. They
resolve the tolerated delay to a factor of 2^(1/8), nine per cent."""
UNFOLLOWED_SHARE = 0.2
OBJECTIVES = (*(f"largest |e|, {name}" for name in DISTURBANCES), "largest |e| in the tail", "largest delay [s]")
UNDISTURBED = (0, 3, 4)
"""The indices of the objectives without a disturbance."""


def l1_side(count: int) -> Side:
    """Measure L1-AC's tunings, first the half with (6), then the half with the other filter. They are two ensembles, because
    their numbers of states differ."""
    points = drawn(L1_KNOBS, count)
    parts, told = [], []
    for make, order, some in ((input_filter, 1, points[::2]), (two_slopes, 2, points[1::2])):
        parts.append(
            _reached([L1Adaptive(gamma=float(gamma), filter=make(float(kappa))) for kappa, gamma in some], STEP["L1-AC"])
        )
        told += [f"order {order}, kappa {short(kappa)} s, Gamma {short(gamma)}" for kappa, gamma in some]
    return Side("L1-AC", tuple(told), np.concatenate(parts))


def robust_side(count: int) -> Side:
    """Measure the robust MRAC's tunings in one ensemble."""
    points = drawn(ROBUST_KNOBS, count)
    tunings = [
        RobustMrac(c_0=section_v.C_0, tau=float(tau), law=LeastSquares(covariance0=float(P_0)), normalization=Normalization(alpha_0=float(a), delta_0=float(d)))
        for tau, P_0, a, d in points
    ]  # fmt: skip
    told = (f"tau {short(tau)} s, P(0) {short(P_0)}, alpha_0 {short(a)}, delta_0 {short(d)}" for tau, P_0, a, d in points)
    return Side("robust MRAC", tuple(told), _reached(tunings, STEP["robust MRAC"]))


def _reached(tunings: Sequence[Controller], h: float) -> Array:
    """Return the objectives of each tuning (K, 5), infinite if a run diverged."""
    given = section_v.problem()
    plain, *disturbed = (
        figures([(_disturbed(given, signal), tuning) for tuning in tunings], T_END, h) for signal in DISTURBANCES.values()
    )
    peaks = [run.max_abs_e.max(axis=1) for run in (plain, *disturbed)]
    found = np.column_stack([*peaks, plain.tail_max_abs_e.max(axis=1), -_delays_tolerated(tunings, h)])
    found[~np.isfinite(found)] = np.inf
    return found


def _delays_tolerated(tunings: Sequence[Controller], h: float) -> Array:
    """Return the tolerated delays [s] (K,), found by a scan of ``DELAYS`` and then by bisection between two of them. The result
    is 0 if even the shortest delay is not tolerated, and the longest delay if all are tolerated."""

    def followed(tuned: Sequence[Controller], delays: Array) -> Array:
        late = [(variant(input=PlantInput(delay=float(delay))), one) for one, delay in zip(tuned, delays, strict=True)]
        return np.asarray(figures(late, DELAYED_T_END, h).tail_max_abs_e.max(axis=1) < UNFOLLOWED_SHARE * _motion())

    every = [one for one in tunings for _ in DELAYS]
    grid = followed(every, np.tile(DELAYS, len(tunings))).reshape(len(tunings), -1)
    first = np.where(grid.all(axis=1), len(DELAYS), np.argmin(grid, axis=1))
    low, high = np.append(0.0, DELAYS)[first], np.append(DELAYS, np.inf)[first]
    between = np.flatnonzero((low > 0) & np.isfinite(high))
    for _ in range(HALVINGS if len(between) else 0):
        middle = np.sqrt(low[between] * high[between])
        holds = followed([tunings[int(i)] for i in between], middle)
        low[between], high[between] = np.where(holds, middle, low[between]), np.where(holds, high[between], middle)
    return low


def _disturbed(given: Problem, signal: Signal | None) -> Problem:
    return given if signal is None else replace(given, disturbance=signal)


def _motion() -> float:
    """Return the largest |x_m|."""
    return ReferenceMotion.of(section_v.problem(), Simulation(t_end=T_END, dt=1e-3)).largest


def claims(*, full: bool = False) -> list[Claim]:
    """Measure both rows from the same tunings."""
    count = MORE if full else BUDGET
    own = _reached([section_v.l1("L1", section_v.FIGURE_4_GAIN)], OWN_STEP)[0]
    l1, robust = l1_side(count), robust_side(count)
    return [better(l1, robust, own), no_advantage(l1, robust)]


OWN_STEP = 2e-5
"""The step for Section V's L1-AC [s]. With it h omega_a is at most 1.4. Figure 4's step, half of it, gives the same five
digits."""
BETTER_FACTOR = 1.1
"""The factor by which an objective must be better. It exceeds one because the search resolves a delay only to nine per cent."""


def factors(side: Side, other: Array) -> Array:
    """Return the factors (K, 5) by which each tuning is better than ``other``, (5,), in each objective. A factor below 1 means
    worse."""
    return np.column_stack([other[:-1] / side.reached[:, :-1], side.reached[:, -1] / other[-1]])


def better(l1: Side, robust: Side, own: Array) -> Claim:
    """Find the tuning of the robust MRAC that beats most tunings of L1-AC, and compare both sides with Section V's L1-AC,
    ``own``."""
    count, sentence, half = len(l1.tunings), SENTENCES["robust-mrac-better"], len(l1.tunings) // 2
    best, beats = _beats_most(robust, l1)
    _, beats_with_6 = _beats_most(robust, l1.first(half))
    _, beats_undisturbed = _beats_most(robust, l1, UNDISTURBED)
    _, beats_both = _beats_most(robust, l1.first(half), UNDISTURBED)
    times, of_l1 = factors(robust, own), factors(l1, own)
    ahead = int(times.min(axis=1).argmax())
    better_too = (of_l1 > BETTER_FACTOR).all(axis=1)
    least, least_of_l1, least_with_6 = (some.min(axis=1).max() for some in (times, of_l1, of_l1[:half]))
    left, ours = (one.unbeaten(other, EVERY) for one, other in ((l1, robust), (robust, l1)))
    told = f"{robust.tunings[ahead]}: {_told_of(robust.reached[ahead])}; L1-AC of Section V: {_told_of(own)}"
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(beats == count, f"none beats more than {beats} of {count}; the best is {robust.tunings[best]}: "
            f"{_told_of(robust.reached[best])}"),
            Reading("no disturbance acts", beats_undisturbed == count, f"none beats more than {beats_undisturbed} of {count} in "
            f"the three remaining objectives"),
            Reading("L1-AC has the paper's filter (6)", beats_with_6 == half, f"none beats more than {beats_with_6} of {half}"),
            Reading("no disturbance acts, and L1-AC has the paper's filter (6)", beats_both == half, f"one beats {beats_both} of "
            f"{half}; these are two conditions, but a weaker reading may have only one", "beside"),
            Reading(
                "some tuning of the robust MRAC is better than the L1-AC of Section V, which is not tuned, in each of the "
                "five objectives, by more than a tenth",
                bool(least > BETTER_FACTOR),
                f"{int((times > BETTER_FACTOR).all(axis=1).sum())} of {count} are; {told}",
                "beside",
            ),
            Reading(
                "no tuning of L1-AC is better than the L1-AC of Section V in this way",
                not better_too.any(),
                f"{int(better_too.sum())} of {count} are, {int(better_too[:half].sum())} of {half} with (6). The best of "
                f"them has a smallest factor of {least_of_l1:.2f}, or {least_with_6:.2f} with (6); the best robust MRAC has "
                f"{least:.2f}",
                "beside",
            ),
        ),
        shows=f"No robust MRAC beats more than {beats} of {count} tuned L1-ACs. One beats Section V's in all "
        f"objectives (at least {least:.2f}-fold); so do {int(better_too.sum())} tuned L1-ACs (best {least_of_l1:.2f}), "
        f"{int(better_too[:half].sum()) or 'none'} with (6).",
        measured=f"the objectives are, in this order, {'; '.join(OBJECTIVES)}. {told}. "
        f"{int((times > BETTER_FACTOR).all(axis=1).sum())} of {count} robust MRACs and {int(better_too.sum())} of {count} L1-ACs "
        f"are better than Section V's L1-AC in all five: the comparison with an untuned scheme also measures the tuning. One "
        f"L1-AC beats at most {_beats_most(l1, robust)[1]} of {count} robust MRACs. The smallest value of each objective (for "
        f"the delay, the largest) over all tunings, for L1-AC and robust MRAC: {_least(l1, robust)}",
        how=f"Section V, {MENDED}, RK4, h = {STEP['L1-AC']:g} s and {STEP['robust MRAC']:g} s, {T_END:g} s, every step; L1-AC of "
        f"Section V: Gamma = {section_v.FIGURE_4_GAIN:g}, h = {OWN_STEP:g} s. Each side has {count} points of a Sobol sequence "
        f"over its parameters, on logarithmic scales: {ranges(L1_KNOBS)}, filter (6) or (2 kappa s + 1)/(kappa s + 1)^2; "
        f"{ranges(ROBUST_KNOBS)}. The delays are {len(DELAYS)} from {DELAYS[0]:g} to {DELAYS[-1]:g} s, then bisected {HALVINGS} "
        f"times, in runs over {DELAYED_T_END:g} s. A run counts as tracking the model if its error in the tail is below "
        f"{UNFOLLOWED_SHARE:g} of the largest |x_m|",
        maps=(_chart(l1, robust),),
        listings=(
            Listing(
                "L1-AC of Section V, the robust MRAC that is farthest ahead of it, and the one that beats most tunings of L1-AC",
                ("scheme", *OBJECTIVES),
                tuple((name, *(short(abs(value)) for value in reached)) for name, reached in (("L1-AC of Section "
                "V", own), *((f"robust MRAC, {robust.tunings[i]}", robust.reached[i]) for i in (ahead, best)))),
            ),
            _listing(l1, left),
            _listing(robust, ours),
        ),
        would_change="holds: one tuning of the robust MRAC that beats every tuning of L1-AC. Whether each is beaten by some "
        "tuning is the question of no-advantage",
        sharpened=f"{MORE} tunings of each side instead of {BUDGET}",
    )  # fmt: skip


EVERY = range(len(OBJECTIVES))


def _beats_most(side: Side, other: Side, objectives: Sequence[int] = EVERY) -> tuple[int, int]:
    """Return the tuning that beats most tunings of the other side, and how many it beats."""
    mine, theirs = side.reached[:, None, objectives], other.reached[None, :, objectives]
    beaten = ((mine <= theirs).all(axis=2) & (mine < theirs).any(axis=2)).sum(axis=1)
    return int(beaten.argmax()), int(beaten.max())


def _told_of(reached: Array) -> str:
    return ", ".join(short(abs(value)) for value in reached)


def no_advantage(l1: Side, robust: Side) -> Claim:
    """Decide whether every tuning of L1-AC is beaten by some tuning of the robust MRAC, from the same tunings."""
    sentence, count = SENTENCES["no-advantage"], len(l1.tunings)
    half = count // 2
    left, undisturbed = l1.unbeaten(robust, EVERY), l1.unbeaten(robust, UNDISTURBED)
    with_6 = l1.first(half).unbeaten(robust.first(half), EVERY)
    ahead, ahead_with_6 = l1.ahead(robust, EVERY), l1.first(half).ahead(robust.first(half), EVERY)
    best, other = (side.reached.min(axis=0) for side in (l1, robust))
    shown = ahead[int(np.argmax((other / best)[ahead]))] if ahead else 0
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(not len(left), f"{len(left)} of {count} tunings of L1-AC are not beaten by any tuning of the robust "
            f"MRAC"),
            Reading("no disturbance acts", not len(undisturbed), f"{len(undisturbed)} of {count} are not beaten"),
            Reading("L1-AC has the paper's filter (6)", not len(with_6), f"{len(with_6)} of {half} are not beaten by as many "
            f"tunings of the robust MRAC, and {int((left < half).sum())} are not beaten by any of all {count}"),
            Reading("in no single objective is the best tuning of L1-AC ahead of the best of the robust "
            "MRAC", not ahead, _told(ahead, l1, robust), "beside"),
            Reading("the same with the paper's filter "
            "(6)", not ahead_with_6, _told(ahead_with_6, l1.first(half), robust.first(half)), "beside"),
        ),
        shows=f"{len(left)} of {count} tuned L1-ACs are unbeaten, {int((left < half).sum())} with (6). L1-AC and robust "
        f"MRAC reach at best {_of_each(shown, l1, robust)} ({OBJECTIVES[shown]}) and delays of {_of_each(-1, l1, robust)} s.",
        measured="the smallest value of each objective (for the delay, the largest) for L1-AC and robust MRAC: "
        f"{_least(l1, robust)}",
        how=f"the runs of robust-mrac-better, {MENDED}: {count} tunings of each side. That row looks for one robust MRAC that "
        "beats every L1-AC; this row looks for an L1-AC that no robust MRAC beats. The effect of a filter on an MRAC with the "
        "same gain is the subject of a different sentence: filter-reduces-margins",
        listings=(
            Listing(
                "The best value of each objective over all tunings",
                ("objective", "L1-AC", "L1-AC with (6)", "robust MRAC"),
                tuple((name, *(short(abs(side.reached[:, i].min())) for side in (l1, l1.first(half), robust))) for i, name in enumerate(OBJECTIVES)),
            ),
        ),
        would_change="holds: tunings of the robust MRAC that beat the remaining ones of L1-AC. Other ranges of the parameters, "
        "or other objectives, may also change the finding",
        sharpened=f"{MORE} tunings of each side instead of {BUDGET}",
    )  # fmt: skip


def _told(ahead: Sequence[int], *sides: Side) -> str:
    led = "; ".join(f"{OBJECTIVES[i]} {_of_each(i, *sides)}" for i in ahead)
    return f"L1-AC is ahead in {len(ahead)} objectives" + (f" (best of L1-AC and robust MRAC: {led})" if led else "")


def _of_each(objective: int, *sides: Side) -> str:
    """Return a phrase with the best value of an objective for each side."""
    return " and ".join(f"{abs(side.reached[:, objective].min()):.2g}" for side in sides)


def _least(*sides: Side) -> str:
    return "; ".join(f"{name} {_of_each(i, *sides)}" for i, name in enumerate(OBJECTIVES))


SHOWN_TUNINGS = 8


def _listing(side: Side, unbeaten: Array) -> Listing:
    """Return a table of some unbeaten tunings, spread over the delays that they tolerate."""
    order = unbeaten[np.argsort(side.reached[unbeaten, -1])]
    shown = order[np.unique(np.linspace(0, len(order) - 1, SHOWN_TUNINGS).round().astype(int))] if len(order) else order
    return Listing(
        f"{side.name}: {len(shown)} of the {len(unbeaten)} tunings that the other side does not beat, by decreasing delay",
        ("tuning", *OBJECTIVES),
        tuple((side.tunings[i], *(short(abs(value)) for value in side.reached[i])) for i in shown),
    )


def _chart(*sides: Side) -> Chart:
    """Draw the smallest error among the tunings that tolerate at least a given delay, without a disturbance and with the worse of
    the two disturbances."""
    curves = []
    for side in sides:
        for words, errors in (("", side.reached[:, 0]), (", disturbed", side.reached[:, 1:3].max(axis=1))):
            least = np.array([errors[-side.reached[:, -1] >= delay * (1 - 1e-9)].min(initial=np.inf) for delay in DELAYS])
            kept = np.isfinite(least)
            curves.append(Curve(f"{side.name}{words}", DELAYS[kept], least[kept]))
    return Chart(
        key="robust-mrac-l1-fronts",
        title="Results of each side's tunings: error against the tolerated delay",
        caption=""
        "The Pareto fronts of all tunings of a side, without a disturbance and with the worse of d = 20 and d = 20 sin 2t. Each "
        "shows the smallest max |e| among the tunings that tolerate at least this input delay. Both sides have the same number "
        "of tunings, drawn evenly over their own parameters; none is selected by hand.",
        x=ChartAxis("tolerated input delay [s]", DELAYS, logarithmic=True),
        quantity="smallest max |e|",
        curves=tuple(curves),
        lost="no tuning tolerates more",
    )  # fmt: skip


ROWS = (
    Measurement(
        claims,
        10.5,
        {
            "robust-mrac-better": "one robust MRAC that does better than every L1-AC",
            "no-advantage": "whether the filter has an advantage over a robust MRAC",
        },
        place=330,
        sharper=partial(claims, full=True),
        sharper_seconds=30.0,
    ),
)
