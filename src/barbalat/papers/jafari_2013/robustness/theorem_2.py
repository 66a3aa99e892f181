"""Theorem 2's trade-off between tau and the modelling error: the observed boundary, its prediction from linear loops, and the
error along it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from barbalat.adaptation.law import Normalization
from barbalat.certificates.linear_loops.frozen import FrozenLoops, ToleratedSizes, tolerated
from barbalat.certificates.linear_loops.ideal import known_parameters
from barbalat.linear.largest import largest
from barbalat.linear.margins import margins
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.papers.claim import Chart, ChartAxis, Claim, Curve, Map, Measurement, numbers, span, table
from barbalat.papers.finding import PROPORTIONAL_SHARE, Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.robustness.delta_2 import ALPHA_0, DELTA_0
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.papers.jafari_2013.statements import MENDED
from barbalat.problem.modelling_error import DelayError, ModellingError, ScaledError
from barbalat.solvers.simulation import Simulation
from barbalat.study.tau_limit import Grown, TauLimits, TauStudy
from barbalat.validate import Array

TAUS = np.geomspace(2.5e-3, 2.0, 20)
SIZES = np.geomspace(5e-3, 0.7, 12)
T_END, BOUNDARY_RUN_FACTOR, STEP = 100.0, 4, 1e-3
"""Horizon [s], a quarter of which contains two periods of the command. The runs at and along the boundary are four times as
long."""
TAU_MULTIPLES = {1.05: "τ 5 % above the boundary", 2.0: "twice the boundary's τ", 4.0: "four times the boundary's τ"}
"""Multiples of the boundary's tau at which the error is measured. On the boundary itself a remaining oscillation hides it."""
FROZEN_TAUS = np.concatenate([np.geomspace(TAUS[0], 0.1, 5), np.geomspace(0.13, 0.36, 6), [0.6, 1.0, TAUS[-1]]])
THEOREM_SIZES = np.array([0.01, 0.05, 0.1])
"""The delays and values of mu [s] for which the boundary is found with (16) and alpha_0 > 0."""
RANGE_TAUS = np.append(np.geomspace(0.01, 0.95 / DELTA_0, 8), np.array([1.5, 3.0, 10.0]) / DELTA_0)
"""Values of tau [s] over most of the interval that Theorem 2 admits, and some values above 1/delta_0."""
RANGE_DELAY = 2e-3
"""A small modelling error: an input delay [s] of two steps."""
DERIVATIVE_POLE = 2e-3
"""Time constant of the realisation of -mu s [s]."""


def claims() -> list[Claim]:
    """Measure the rows for an input delay and for Delta_m = -mu s."""
    derivative = ScaledError(TransferFunction([-1.0, 0.0], [DERIVATIVE_POLE, 1.0]))
    realised = f"-mu s/({DERIVATIVE_POLE} s + 1)"
    axis = "delay at the plant's input [s]"
    delay = TauTradeOff("delay", "the delay", "a delay of", axis, "an input delay", "exact delay", DelayError())
    shown = "Δₘ = " + realised.replace("mu ", "μ")
    mu = TauTradeOff("mu", "mu", "mu =", "μ [s]", shown, f"Delta_m = {realised}, a proper realisation", derivative)
    return [delay.claim(), mu.claim(), _range_of_tau(delay), _minus_mu_s(delay, mu)]


@dataclass(frozen=True, eq=False)
class TauTradeOff:
    """One family of modelling errors in Section V's case: the runs, the linear loops and the pictures."""

    key: str
    word: str
    at: str
    axis: str
    title: str
    what: str
    error: ModellingError

    @cached_property
    def study(self) -> TauStudy:
        return TauStudy(problem=section_v.problem(), controller=section_v.robust_mrac("r"), error=self.error)

    @cached_property
    def limits(self) -> TauLimits:
        near = Simulation(t_end=BOUNDARY_RUN_FACTOR * T_END, dt=STEP)
        return self.study.limits(SIZES, TAUS, Simulation(t_end=T_END, dt=STEP), near=near)

    @cached_property
    def bounded(self) -> Array:
        """The indices of the sizes that have a boundary, which means that some tau of the scan tolerates them and smaller values
        do not."""
        return np.flatnonzero(np.isfinite(self.limits.tolerates) & (self.limits.loses > 0))

    @cached_property
    def along(self) -> Array:
        """max |e| in the tail of the longer runs at multiples of the boundary's tau (multiples, bounded); NaN if lost."""
        sizes, taus = SIZES[self.bounded], self.limits.tolerates[self.bounded]
        pairs = np.tile(sizes, len(TAU_MULTIPLES)), np.concatenate([multiple * taus for multiple in TAU_MULTIPLES])
        return self.study.tail_errors(*pairs, Simulation(t_end=BOUNDARY_RUN_FACTOR * T_END, dt=STEP)).reshape(
            len(TAU_MULTIPLES), -1
        )

    @cached_property
    def frozen(self) -> list[ToleratedSizes]:
        """The sizes that the linear loops tolerate, for ``FROZEN_TAUS``."""
        return [tolerated(frozen_loops(float(tau)), self.error) for tau in FROZEN_TAUS]

    @cached_property
    def normalised(self) -> TauLimits:
        """The study at ``THEOREM_SIZES`` with (16)."""
        near = Simulation(t_end=BOUNDARY_RUN_FACTOR * T_END, dt=STEP)
        return self.with_16.limits(THEOREM_SIZES, TAUS, Simulation(t_end=T_END, dt=STEP), near=near)

    @cached_property
    def with_16(self) -> TauStudy:
        """The study with the normalising signal (16), as Theorem 2 requires."""
        controller = replace(section_v.robust_mrac("r"), normalization=Normalization(alpha_0=ALPHA_0, delta_0=DELTA_0))
        return TauStudy(problem=section_v.problem(), controller=controller, error=self.error)

    @property
    def literal(self) -> tuple[Reading, str]:
        """The reading with the setting of Theorem 2, and a phrase with its results."""
        tolerates, loses = self.normalised.tolerates, self.normalised.loses
        said = f"the smallest sufficient tau is {numbers(tolerates)} s for {self.at} {numbers(THEOREM_SIZES)} s"
        holds = bool(np.isfinite(tolerates).all() and (loses > 0).all() and (np.diff(tolerates) > 0).all())
        return SENTENCES[f"tau-limit-{self.key}"].reads(holds, f"{said}; alpha_0 = {ALPHA_0:g}, delta_0 = {DELTA_0:g}"), said

    def claim(self) -> Claim:
        limits, at = self.limits, self.bounded
        sizes, taus, along = SIZES[at], limits.tolerates[at], self.along
        linear = np.array([self.error.limit(frozen_loops(float(tau)).at_theta) for tau in taus]) / sizes
        gain = np.array([each.small_gain / each.limit for each in self.frozen])
        doubled = (along[1] / along[0])[np.isfinite(along[:2]).all(axis=0)]
        literal, said = self.literal
        beside = Reading(
            f"with Section V's alpha_0 = 0, tau's limit rises from each of {len(sizes)} sizes to the next, and by more than a "
            f"factor of two in all",
            bool((np.diff(taus) > 0).all()) and bool(taus[-1] > 2 * taus[0]),
            f"{taus[0]:.3g} to {taus[-1]:.3g} s",
            "beside",
        )
        return Claim(
            sentence=SENTENCES[f"tau-limit-{self.key}"],
            readings=(literal, beside),
            shows=f"{said[0].upper()}{said[1:]}.",
            measured=            f"the smallest tau that keeps the run bounded is {taus[0]:.3g} s for {self.at} "
                f"{sizes[0]:.3g} s and {taus[-1]:.3g} s for {sizes[-1]:.3g} s, which is {(taus / sizes).min():.2f} to "
                f"{(taus / sizes).max():.2f} times {self.word}. No tau tried keeps it bounded with "
                f"{self._nothing_tolerated()}. At these values of tau the linear loop with the estimates frozen at theta loses "
                f"stability at {linear.min():.3f} to {linear.max():.3f} times {self.word}{_agree(linear, sizes)}. The "
                f"small-gain theorem shows this loop stable up to {gain.min():.2f} to {gain.max():.2f} of its limit. Along the "
                f"boundary, at a tau 5 % above it, the tail error grows from {along[0, 0]:.2g} to {np.nanmax(along[0]):.2g}; at "
                f"twice the boundary's tau it is {doubled.min():.2f} to {doubled.max():.2f} times as large",
            how=f"Section V, robust MRAC, {MENDED}, {self.what}, RK4, h = {STEP:g} s, {T_END:g} s, {len(SIZES)} sizes x "
            f"{len(TAUS)} values of tau, then bisection "
            f"to 1 % over {BOUNDARY_RUN_FACTOR * T_END:g} s: {limits.runs} runs. {LOSS_CRITERION}. "
            "The frozen loop follows from the scheme's equations by exact Jacobians; it does not guarantee anything for the "
            "adapting loop",
            maps=(self._map(), self._chart()),
            would_change="a tau that keeps runs bounded with every size, or a boundary that does not rise with the size. The "
                "Delta* of the theorem is not computed",
        )  # fmt: skip

    def _nothing_tolerated(self) -> str:
        none = SIZES[np.isnan(self.limits.tolerates)]
        return f"{self.at} {none[0]:.3g} s" if len(none) else "more than the largest value tried"

    def _map(self) -> Map:
        at, limit, gain = self.bounded, *np.array([(each.limit, each.small_gain) for each in self.frozen]).T
        over_set = np.array([each.over_set for each in self.frozen], dtype=float)
        known = over_set > 0
        return Map(
            key=f"tau-{self.key}",
            title=f"Theorem 2's trade-off: τ against {self.title}",
            caption=f"Each cell is a run of the robust MRAC on Section V with {self.title}, over {T_END:g} s with RK4, h = "
            f"{STEP * 1e3:g} ms. {LOSS_CRITERION}. "
            f"Marks: the smallest τ that keeps runs of {BOUNDARY_RUN_FACTOR * T_END:g} s bounded, bisected to 1 %; these longer "
            f"runs show growth that is too slow for the cells' shorter runs. Cells at large τ and large modelling errors are "
            f"lost because a transient of the learning outlasts the first quarter. The lines refer to the linear loop with "
            f"frozen estimates. They show its exact stability limit with θ̂ = θ, and the limits up to which the small-gain "
            f"theorem shows it stable, with θ̂ = θ and with the worst θ̂ found in the known set. The last limit is an estimate; "
            f"above the end of its line the frozen loop is unstable with some θ̂ even without modelling error. None of the "
            f"lines is "
            "a guarantee for the adapting loop, whose estimates move.",
            x=ChartAxis(self.axis, SIZES, logarithmic=True),
            y=ChartAxis("τ [s]", TAUS, logarithmic=True),
            values=self.limits.tail.T,
            quantity="max |e| in the last quarter",
            logarithmic=True,
            lost="lost",
            curves=(
                Curve("frozen at θ: exact limit", limit, FROZEN_TAUS),
                Curve("frozen at θ: small gain", gain, FROZEN_TAUS),
                Curve("frozen anywhere in the set: small gain", over_set[known], FROZEN_TAUS[known]),
                Curve("observed boundary", SIZES[at], self.limits.tolerates[at], marks=True),
            ),
        )

    def _chart(self) -> Chart:
        sizes = SIZES[self.bounded]
        curves = [
            Curve(name, sizes[np.isfinite(row)], row[np.isfinite(row)])
            for name, row in zip(TAU_MULTIPLES.values(), self.along, strict=True)
        ]
        return Chart(
            key=f"tau-error-{self.key}",
            title=f"The error along the boundary: {self.title}",
            caption=f"The chart shows the cost of the smallest τ: the largest |e| in the last quarter of runs over "
            f"{BOUNDARY_RUN_FACTOR * T_END:g} s, at multiples of the τ at the observed boundary. Below this boundary runs "
            f"are lost. Away from the largest sizes the error is proportional to τ.",
            x=ChartAxis(self.axis, SIZES, logarithmic=True),
            quantity="max |e| in the last quarter",
            curves=tuple(curves),
            lost="lost beyond this point, or lost for every τ",
        )


def _range_of_tau(delay: TauTradeOff) -> Claim:
    """Measure whether one delay is tolerated at every tau that Theorem 2 admits, and at larger ones."""
    sentence, t_end = SENTENCES["tau-range"], BOUNDARY_RUN_FACTOR * T_END
    tails = delay.with_16.tail_errors(np.full(len(RANGE_TAUS), RANGE_DELAY), RANGE_TAUS, Simulation(t_end=t_end, dt=STEP))
    admitted = RANGE_TAUS < 1 / DELTA_0
    inside, beyond = (np.isfinite(tails[which]) for which in (admitted, ~admitted))
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(bool(inside.all()), f"{inside.sum()} of {len(inside)} values of tau from {RANGE_TAUS[0]:g} to "
                f"{RANGE_TAUS[admitted][-1]:.3g} s keep the run bounded with a delay of {RANGE_DELAY:g} s"),
            Reading("the upper limit is needed: no tau above 1/delta_0 keeps the run bounded", not beyond.any(),
            f"{beyond.sum()} of {len(beyond)} values from {RANGE_TAUS[~admitted][0]:g} to {RANGE_TAUS[-1]:g} s do", "beside"),
        ),
        shows=f"A delay of {RANGE_DELAY:g} s is tolerated at {inside.sum()} of {len(inside)} values of tau below 1/delta_0 = "
        f"{1 / DELTA_0:g} s, and at {beyond.sum()} of {len(beyond)} above it.",
        measured=f"the largest |e| in the tail is {span(tails[admitted])} for tau below 1/delta_0 and {span(tails[~admitted])} "
            f"above it",
        how=f"Section V, robust MRAC, {MENDED}, with (16), alpha_0 = {ALPHA_0:g}, delta_0 = {DELTA_0:g}, exact delay of "
        f"{RANGE_DELAY:g} s, RK4, h = {STEP:g} s, {t_end:g} s. {LOSS_CRITERION}",
        listings=(table(f"The robust MRAC with a delay of {RANGE_DELAY:g} s", {"tau [s]": RANGE_TAUS, "max |e|, tail": tails}),),
        would_change="a longer delay: below some tau the run is then lost (tau-limit-delay). Theorem 2 itself has no row, "
        "because it does not give Delta*",
    )  # fmt: skip


def _minus_mu_s(delay: TauTradeOff, mu: TauTradeOff) -> Claim:
    """Compare the sizes of a delay and of -mu s that loops tolerate: the loop with theta known, and the robust MRAC's frozen
    loops."""
    sentence, limits = SENTENCES["minus-mu-s"], [np.array([each.limit for each in of.frozen]) for of in (delay, mu)]
    ratios, plant = limits[1] / limits[0], section_v.problem().plant
    known = known_parameters(plant, plant.theta)
    margin, tolerated_mu = margins(known).delay, _largest_mu(known)
    ratio = tolerated_mu / margin
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(abs(ratio - 1) < PROPORTIONAL_SHARE, f"the loop tolerates mu = {tolerated_mu:.4g} s for Delta_m = -mu "
            f"s, and a delay of {margin:.4g} s"),
            Reading(
                "the same holds for the robust MRAC's loops with frozen estimates, for every tau",
                bool((np.abs(ratios - 1) < PROPORTIONAL_SHARE).all()),
                f"the tolerated mu is {span(ratios)} times the tolerated delay, for delays of {span(limits[0])} s: if |L| = 1 at "
                f"a high frequency, mu times that frequency is not small",
                "beside",
            ),
        ),
        shows=f"With theta known the loop tolerates mu = {tolerated_mu:.3g} s for -mu s and a delay of {margin:.3g} s; for "
        f"robust MRACs mu is {ratios.min():.2g} to {ratios.max():.3g} times the delay.",
        measured=f"the loop with theta known tolerates mu = {tolerated_mu:.4g} s, {ratio:.3f} times its delay margin. Over "
            f"{len(FROZEN_TAUS)} values of tau, the frozen loop of the robust MRAC tolerates delays of {span(limits[0])} s and "
            f"values of mu of {span(limits[1])} s",
        how="with theta known, the exact characteristic roots of 1 + L (1 - mu s); for the frozen loops of the robust MRAC, "
        f"{MENDED}, -mu s is realised as -mu s/({DERIVATIVE_POLE} s + 1)",
        listings=(table("Tolerated by the frozen loop", {"tau [s]": FROZEN_TAUS, "delay [s]": limits[0], "mu "
        "[s]": limits[1], "mu/delay": ratios}),),
        would_change="a loop with theta known whose delay margin corresponds to a large phase at the frequency at which |L| = 1",
    )  # fmt: skip


def _largest_mu(loop: StateSpace) -> float:
    """Return the largest mu [s] for which den + num (1 - mu s) is Hurwitz, with L = num/den."""
    L = loop.transfer_function()

    def is_stable(mu: float) -> bool:
        return bool(np.roots(np.polyadd(L.den, np.polymul(L.num, [-mu, 1.0]))).real.max() < 0)

    return largest(is_stable, 1e-6, 1e3, within=1e-10)


AGREEMENT_SHARE = 0.02
"""The linear limit and the observed boundary agree if they differ by less than this fraction of the size. The boundary is
resolved to 1 % of tau."""


@cache
def frozen_loops(tau: float) -> FrozenLoops:
    """Return the frozen loops of Section V's robust MRAC, which both families of modelling errors share."""
    return FrozenLoops(section_v.problem(), section_v.robust_mrac("r", tau))


def _agree(linear: Array, sizes: Array) -> str:
    """Return a phrase with the size up to which the linear limit agrees with the observed boundary."""
    differs = np.append(np.abs(linear - 1) > AGREEMENT_SHARE, True)
    first = int(np.argmax(differs))
    return f" (within {AGREEMENT_SHARE:.0%} of it up to {sizes[first - 1]:.3g} s)" if first else ""


LOSS_CRITERION = (
    f"A run is lost if it diverges, if the largest |e| of the last quarter is more than {Grown().growth:g} times that of the "
    "best earlier quarter, or if |e| exceeds the largest |x_m| after the first quarter"
)


ROWS = (
    Measurement(
        claims,
        6.0,
        {
            "tau-limit-delay": "the lower limit of tau with an input delay",
            "tau-limit-mu": "the lower limit of tau with Delta_m = -mu s",
            "tau-range": "one delay at the values of tau that Theorem 2 admits",
            "minus-mu-s": "-mu s instead of an input delay",
        },
        place=240,
    ),
)
