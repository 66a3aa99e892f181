"""The robust MRAC against L1-AC, both tuned by one rule: as many tunings of each, drawn evenly over its own knobs.

No setting is chosen: a tuning counts as beaten when one of the other side is worse in no objective and better in one. What is left
unbeaten on either side is what the other can't reach. The objectives are those that the paper names, as far as every tuning has them:
the transient, the tracking error, unmodelled dynamics (an input delay); and a bounded disturbance, which Section IV names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from barbalat.adaptation.law import Normalization
from barbalat.adaptation.laws import LeastSquares
from barbalat.controllers import L1Adaptive, RobustMrac
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.papers.claim import Chart, ChartAxis, Claim, Curve, Listing, Measurement, short
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import figures, variant
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.problem.actuation import PlantInput
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller, Signal
from barbalat.signals import Constant, Sine
from barbalat.solvers.simulation import Simulation
from barbalat.study.reference_motion import ReferenceMotion
from barbalat.validate import Array

BUDGET, MORE = 64, 256
"""Tunings of each side, by the plain command and by ``--full``: powers of two, as Sobol's sequence is even in."""
SEED = 20130821  # any fixed number: the draws are the same on every machine
TIMES = (2e-3, 0.5)
"""[s]: of kappa and of tau, the same for both sides."""
L1_KNOBS = {"kappa": TIMES, "Gamma": (0.3, 300.0)}
"""Of L1-AC, each spaced evenly in its logarithm: the filter's time constant [s] and the gain, up to what the step resolves. The filter is (6) for half of the
tunings, and for the other half that of second order with two slopes of 1 - C."""
ROBUST_KNOBS = {"tau": TIMES, "P(0)": (1.0, 1e3), "alpha_0": (1e-3, 1.0), "delta_0": (0.05, 1.0)}
"""Likewise of the robust MRAC: 1/delta_0 is not below the largest tau."""
STEP = {"L1-AC": 1e-4, "robust MRAC": 5e-4}
"""[s]: h omega_a is 1.2 or less for the one, h/tau 0.25 and h P(0) 0.5 or less for the other."""
T_END, DELAYED_T_END = 60.0, 36.0
"""[s]: beside a delay the run has three periods of the command."""
DISTURBANCES: dict[str, Signal | None] = {"no disturbance": None, "d = 20": Constant(20.0), "d = 20 sin 2t": Sine(20.0, 2.0)}
"""About a hundredth of the largest control."""
DELAYS = np.geomspace(2e-3, 1.0, 10)
"""[s], from one to the next a factor of two: the largest below the first with which the tail's error passes a fifth of the model's motion."""
UNFOLLOWED_SHARE = 0.2
OBJECTIVES = (*(f"largest |e|, {name}" for name in DISTURBANCES), "largest |e| in the tail", "largest delay [s]")
UNDISTURBED = (0, 3, 4)
"""The places of the objectives without a disturbance."""


@dataclass(frozen=True, eq=False)
class Side:
    """One scheme's tunings, described, and what they reach: (K, 5) in the order of ``OBJECTIVES``, the delay negative; less is better."""

    name: str
    tunings: tuple[str, ...]
    reached: Array

    def unbeaten(self, other: Side, objectives: Sequence[int]) -> Array:
        """The places of the tunings that no tuning of the other side beats."""
        mine, theirs = self.reached[:, None, objectives], other.reached[None, :, objectives]
        beaten = ((theirs <= mine).all(axis=2) & (theirs < mine).any(axis=2)).any(axis=1)
        return np.flatnonzero(~beaten & np.isfinite(self.reached[:, 0]))


def drawn(knobs: dict[str, tuple[float, float]], count: int) -> Array:
    """(count, knobs) points of Sobol's sequence, spaced in the logarithms."""
    from scipy.stats.qmc import Sobol

    low, high = np.log(np.array(list(knobs.values()))).T
    unit = Sobol(len(knobs), seed=SEED).random(count)
    return np.asarray(np.exp(low + unit * (high - low)))


def two_slopes(kappa: float) -> TransferFunction:
    """(2 kappa s + 1)/(kappa s + 1)^2: 1 - C begins with s^2."""
    return TransferFunction([2 * kappa, 1.0], [kappa**2, 2 * kappa, 1.0])


def l1_side(count: int) -> Side:
    """Half of the tunings have each filter: two ensembles, as their states differ in number."""
    points = drawn(L1_KNOBS, count)
    parts, told = [], []
    for make, order, some in ((input_filter, 1, points[::2]), (two_slopes, 2, points[1::2])):
        parts.append(
            _reached([L1Adaptive(gamma=float(gamma), filter=make(float(kappa))) for kappa, gamma in some], STEP["L1-AC"])
        )
        told += [f"order {order}, kappa {short(kappa)} s, Gamma {short(gamma)}" for kappa, gamma in some]
    return Side("L1-AC", tuple(told), np.concatenate(parts))


def robust_side(count: int) -> Side:
    """All in one ensemble."""
    points = drawn(ROBUST_KNOBS, count)
    tunings = [
        RobustMrac(c_0=section_v.C_0, tau=float(tau), law=LeastSquares(covariance0=float(P_0)), normalization=Normalization(alpha_0=float(a), delta_0=float(d)))
        for tau, P_0, a, d in points
    ]  # fmt: skip
    told = (f"tau {short(tau)} s, P(0) {short(P_0)}, alpha_0 {short(a)}, delta_0 {short(d)}" for tau, P_0, a, d in points)
    return Side("robust MRAC", tuple(told), _reached(tunings, STEP["robust MRAC"]))


def _reached(tunings: Sequence[Controller], h: float) -> Array:
    """(K, 5) the objectives of each; infinite where a run diverged."""
    given = section_v.problem()
    plain, *disturbed = (
        figures([(_disturbed(given, signal), tuning) for tuning in tunings], T_END, h) for signal in DISTURBANCES.values()
    )
    peaks = [run.max_abs_e.max(axis=1) for run in (plain, *disturbed)]
    late = [variant(input=PlantInput(delay=float(delay))) for delay in DELAYS]
    tails = figures([(problem, tuning) for tuning in tunings for problem in late], DELAYED_T_END, h).tail_max_abs_e.max(axis=1)
    followed = tails.reshape(len(tunings), -1) < UNFOLLOWED_SHARE * _motion()
    first = np.where(followed.all(axis=1), len(DELAYS), np.argmin(followed, axis=1))
    found = np.column_stack([*peaks, plain.tail_max_abs_e.max(axis=1), -np.append(0.0, DELAYS)[first]])
    found[~np.isfinite(found)] = np.inf
    return found


def _disturbed(given: Problem, signal: Signal | None) -> Problem:
    return given if signal is None else replace(given, disturbance=signal)


def _motion() -> float:
    """The largest |x_m|."""
    return ReferenceMotion.of(section_v.problem(), Simulation(t_end=T_END, dt=1e-3)).largest


def claim(*, full: bool = False) -> Claim:
    """The tunings of either side that the other does not beat."""
    count, every = MORE if full else BUDGET, range(len(OBJECTIVES))
    l1, robust = l1_side(count), robust_side(count)
    left, ours = l1.unbeaten(robust, every), robust.unbeaten(l1, every)
    undisturbed, of_robust = l1.unbeaten(robust, UNDISTURBED), robust.unbeaten(l1, UNDISTURBED)
    sentence = SENTENCES["robust-mrac-better"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(not len(left), f"{len(left)} of {count} tunings of L1-AC are beaten by none of the robust MRAC, {len(ours)} of {count} the other way round"),
            Reading(
                "no disturbance acts: the objectives are then the largest error, that in the tail, and the delay",
                not len(undisturbed),
                f"{len(undisturbed)} tunings of L1-AC are beaten by none of the robust MRAC, {len(of_robust)} the other way round",
            ),
        ),
        shows=f"Unbeaten of {count} tunings each: L1-AC {len(left)}, robust MRAC {len(ours)}. Least |e| with d = 20: {_of_each(1, l1, robust)}; longest delay: {_of_each(-1, l1, robust)} s.",
        measured=f"least of each objective, L1-AC and robust MRAC: {_least(l1, robust)}",
        how=f"Section V, RK4, h = {STEP['L1-AC']:g} s and {STEP['robust MRAC']:g} s, {T_END:g} s, every step; {count} points of Sobol's sequence for each side over its own knobs, spaced in their logarithms: "
        f"{_ranges(L1_KNOBS)}, filter (6) or (2 kappa s + 1)/(kappa s + 1)^2; {_ranges(ROBUST_KNOBS)}. Delays: {len(DELAYS)} from {DELAYS[0]:g} to {DELAYS[-1]:g} s, over {DELAYED_T_END:g} s; followed while the tail's error is below "
        f"{UNFOLLOWED_SHARE:g} of the largest |x_m|",
        maps=(_chart(l1, robust),),
        listings=(_listing(l1, left), _listing(robust, ours)),
        would_change="holds: tunings of the robust MRAC that beat those of L1-AC that are left; other objectives, ranges of the knobs, commands or plants",
        sharpened=f"{MORE} tunings of each side instead of {BUDGET}",
    )  # fmt: skip


def _ranges(knobs: dict[str, tuple[float, float]]) -> str:
    return ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in knobs.items())


def _of_each(objective: int, *sides: Side) -> str:
    """The best value of an objective on each side."""
    return " and ".join(f"{abs(side.reached[:, objective].min()):.2g}" for side in sides)


def _least(*sides: Side) -> str:
    return "; ".join(f"{name} {_of_each(i, *sides)}" for i, name in enumerate(OBJECTIVES))


SHOWN_TUNINGS = 8


def _listing(side: Side, unbeaten: Array) -> Listing:
    """Some that are unbeaten, spread over the delays that they bear."""
    order = unbeaten[np.argsort(side.reached[unbeaten, -1])]
    shown = order[np.unique(np.linspace(0, len(order) - 1, SHOWN_TUNINGS).round().astype(int))] if len(order) else order
    return Listing(
        f"{side.name}: {len(shown)} of the {len(unbeaten)} tunings that the other side does not beat, by falling delay",
        ("tuning", *OBJECTIVES),
        tuple((side.tunings[i], *(short(abs(value)) for value in side.reached[i])) for i in shown),
    )


def _chart(*sides: Side) -> Chart:
    """The least error, without a disturbance and with the worse of both, among the tunings that bear a delay."""
    curves = []
    for side in sides:
        for words, errors in (("", side.reached[:, 0]), (", disturbed", side.reached[:, 1:3].max(axis=1))):
            least = np.array([errors[-side.reached[:, -1] >= delay * (1 - 1e-9)].min(initial=np.inf) for delay in DELAYS])
            kept = np.isfinite(least)
            curves.append(Curve(f"{side.name}{words}", DELAYS[kept], least[kept]))
    return Chart(
        key="robust-mrac-l1-fronts",
        title="What each side's tunings reach: error against the delay that is borne",
        caption="The front of all tunings of a side: the least largest |e| among those that follow beside at least such an input delay, without a disturbance and with the worse of d = 20 and "
        "d = 20 sin 2t. Both sides have as many tunings, drawn evenly over their own knobs; none is chosen.",
        x=ChartAxis("input delay that is borne [s]", DELAYS, logarithmic=True),
        quantity="least of the largest |e|",
        curves=tuple(curves),
        lost="no tuning bears more",
    )  # fmt: skip


ROWS = (
    Measurement(
        claim,
        6.5,
        {"robust-mrac-better": "the robust MRAC against L1-AC, both tuned by one rule"},
        place=330,
        sharper=partial(claim, full=True),
        sharper_seconds=26.0,
    ),
)
