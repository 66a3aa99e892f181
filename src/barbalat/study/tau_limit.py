"""The trade-off of Theorem 2 by simulation: tau of the robust MRAC against the size of a modelling error, with the boundary in
tau.

The trade-off is measured in runs of the adapting loop and is not a guarantee. The corresponding linear loop is in
``certificates.linear_loops.frozen``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from barbalat import validate
from barbalat.budget import Progress, part_of
from barbalat.controllers import RobustMrac
from barbalat.linear.largest import halvings
from barbalat.pictures.plotted import Plotted
from barbalat.problem.modelling_error import ModellingError
from barbalat.problem.state_feedback import Problem
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.solvers.simulation import Simulation
from barbalat.study.reference_motion import ReferenceMotion
from barbalat.validate import Array, InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROUNDING_SHARE = 1e-9
"""Fraction of the model's motion below which the growth of errors may be due to rounding."""


@dataclass(frozen=True, kw_only=True)
class Grown:
    """The criterion for a lost run: it diverged, its error grew late in the run, or its error became as large as the model's
    motion.

    growth  the largest |e| in the last quarter of the run, relative to that in the best earlier quarter, > 1. It detects an
            oscillation that starts and stays bounded, and an unstable mode of rate sigma [1/s] once it dominates the error and
            sigma t_end/4 > ln(growth). Each quarter should contain the same part of the command, such as one or more whole
            periods
    share   limit on the largest |e| after the first quarter, which is reserved for learning, as a fraction of the largest |x_m|
            of the run; detects bounded oscillations and passing bursts
    """

    growth: float = 1.5
    share: float = 1.0

    def __post_init__(self) -> None:
        validate.freeze(self, share=validate.positive("share", self.share), growth=validate.positive("growth", self.growth))
        if self.growth <= 1:
            raise InputError(f"growth must be above 1, got {self.growth:g}")

    def judge(self, quarters: Array, amplitude: float) -> Array:
        """Return (M,) whether runs are lost, from the largest |e| in each quarter, (M, 4, n), NaN if diverged, and the largest
        |x_m|."""
        errors = quarters.max(axis=2)
        allowed = np.maximum(self.growth * errors[:, :-1].min(axis=1), ROUNDING_SHARE * amplitude)
        tolerated = (errors[:, -1] <= allowed) & (errors[:, 1:].max(axis=1) <= self.share * amplitude)  # NaN is lost
        return np.asarray(~tolerated)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class TauLimits(Plotted):
    """The results for S sizes of the modelling error and K values of tau.

    tail          (S, K) max |e| in the run's last quarter; NaN if the run is lost
    tolerates     (S,) the smallest tau found that is tolerated, with every smaller tau of the scan lost; NaN if no tau is
                  tolerated
    loses         (S,) the largest tau found below ``tolerates`` that is lost; 0 if the scan found none
    at_tolerated  (S,) max |e| in the last quarter of the run at ``tolerates``; NaN if no tau is tolerated
    runs          number of simulations
    """

    sizes: Array
    taus: Array
    tail: Array
    tolerates: Array
    loses: Array
    at_tolerated: Array
    runs: int

    def __repr__(self) -> str:
        tolerated = self.tolerates[np.isfinite(self.tolerates)]
        least = f"tau from {tolerated.min():.4g} to {tolerated.max():.4g} tolerated" if len(tolerated) else "no tau tolerated"
        sizes = f"{len(self.sizes)} sizes of the modelling error, {len(self.taus)} of tau"
        return f"<TauLimits for {sizes}: {least}; {self.runs} runs>"

    def plot(self, *, shown: bool = True) -> Figure:
        """The smallest tolerated tau over the modelling error, and the error over tau, as a Matplotlib figure.

        shown  whether to display the figure at once, if pyplot is in use
        """
        return _drawn(self, shown=shown)


@dataclass(frozen=True, eq=False, kw_only=True)
class TauStudy:
    """One problem with one robust MRAC, whose tau is varied, and one family of modelling errors.

    The simulation must be able to represent the sizes: a delay is at least two solver steps. Raises InputError.
    """

    problem: Problem
    controller: RobustMrac
    error: ModellingError
    lost: Grown = Grown()

    def __post_init__(self) -> None:
        validate.instance("problem", self.problem, Problem)
        validate.instance("controller", self.controller, RobustMrac)
        validate.instance("lost", self.lost, Grown)
        if self.problem.plant.inputs > 1:
            raise InputError(f"the robust MRAC supports one input, but plant.b has {self.problem.plant.inputs} columns")

    def tail_errors(
        self, sizes: Array, taus: Array, simulation: Simulation, *, threads: int | None = None, progress: Progress | None = None
    ) -> Array:
        """(M,) max |e| in the last quarter of one run for each pair of ``sizes`` and ``taus``; NaN if the run is lost."""
        members = [self._member(float(size), float(tau)) for size, tau in zip(sizes, taus, strict=True)]
        if not members:
            return np.zeros(0)
        found = simulate_ensemble(members, simulation, quarters=True, threads=threads, progress=progress)
        assert found.quarters is not None
        lost = self.lost.judge(found.quarters, _amplitude(self.problem, simulation))
        return np.where(lost, np.nan, found.metrics.tail_max_abs_e.max(axis=1))

    def limits(
        self,
        sizes: Any,
        taus: Any,
        simulation: Simulation,
        *,
        near: Simulation | None = None,
        resolution: float = 0.01,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> TauLimits:
        """Compute the map over all pairs, then bisect at each size between the smallest tolerated tau and the next smaller tau.

        sizes, taus  ascending, above zero
        near         simulation settings near the boundary; by default those of the map. A longer run detects slower growth: a tau
                     that is tolerated on the map and lost there counts as lost, and the next larger tau is tried
        resolution   relative distance of ``tolerates`` and ``loses`` at which bisection ends
        """
        sizes, taus = _ascending("sizes", sizes), _ascending("taus", taus)
        ratio = float((taus[1:] / taus[:-1]).max(initial=1.0))
        rounds = halvings(ratio, validate.positive("resolution", resolution))
        longer, to_come = near or simulation, rounds + 1
        grid = np.repeat(sizes, len(taus)), np.tile(taus, len(sizes))
        shape = len(sizes), len(taus)
        tail = self.tail_errors(*grid, simulation, threads=threads, progress=part_of(progress, 0.0, 0.5)).reshape(shape)
        search = _TauSearch(sizes, taus, tail)
        done = 0.5
        while len((chosen := search.open_members(rounds))[0]):
            width = (1 - done) / max(to_come, 2)  # if a longer run disagrees, further rounds follow
            step = part_of(progress, done, width)
            search.take(chosen[0], self.tail_errors(sizes[chosen[0]], chosen[1], longer, threads=threads, progress=step))
            done, to_come = done + width, to_come - 1
        if progress is not None:
            progress(1.0)
        return TauLimits(
            sizes=sizes,
            taus=taus,
            tail=tail,
            tolerates=search.tolerates,
            loses=search.loses,
            at_tolerated=search.error,
            runs=tail.size + search.runs,
        )

    def _member(self, size: float, tau: float) -> tuple[Problem, RobustMrac]:
        return self.problem.with_inputs(lambda path: self.error.added(path, size)), replace(self.controller, tau=tau)


@lru_cache(maxsize=8)
def _amplitude(problem: Problem, simulation: Simulation) -> float:
    """The largest |x_m| of the run, computed once for all rounds of a search."""
    return ReferenceMotion.of(problem, simulation).largest


class _TauSearch:
    """The brackets of S sizes: the search goes up the scan to a tau that is also tolerated near the boundary, then bisects below
    it."""

    def __init__(self, sizes: Array, taus: Array, tail: Array) -> None:
        tolerated = ~np.isnan(tail)
        self.taus = taus
        self.next = np.where(tolerated.any(axis=1), tolerated.argmax(axis=1), len(taus))  # index of the tau to try
        self.tolerates, self.error = np.full(len(sizes), np.nan), np.full(len(sizes), np.nan)
        self.loses = np.where(self.next > 0, np.append(0.0, taus)[self.next], 0.0)
        self.halved, self.runs = np.zeros(len(sizes), dtype=int), 0

    def open_members(self, halvings: int) -> tuple[Array, Array]:
        """Indices of the unfinished sizes, and the tau to try for each."""
        climbing = np.isnan(self.tolerates) & (self.next < len(self.taus))
        between = (self.loses > 0) & (self.halved < halvings) & ~np.isnan(self.tolerates)
        chosen = np.flatnonzero(climbing | between)
        scanned = self.taus[np.minimum(self.next, len(self.taus) - 1)]
        self.trial = np.where(np.isnan(self.tolerates), scanned, np.sqrt(self.tolerates * self.loses))
        return chosen, self.trial[chosen]

    def take(self, chosen: Array, tail: Array) -> None:
        """Update the brackets with the results."""
        lost, trial = np.isnan(tail), self.trial[chosen]
        climbing = np.isnan(self.tolerates[chosen])
        self.next[chosen[climbing]] += 1
        self.halved[chosen[~climbing]] += 1
        self.loses[chosen[lost]] = trial[lost]
        self.tolerates[chosen[~lost]], self.error[chosen[~lost]] = trial[~lost], tail[~lost]
        self.runs += len(chosen)


def _ascending(name: str, values: Any) -> Array:
    given = validate.vector(name, values)
    if len(given) == 0 or given[0] <= 0 or not (np.diff(given) > 0).all():
        raise InputError(f"{name} must be ascending values above zero, got {validate.show(values)}")
    return given


FIGURE_HEIGHT = 3.8
"""Height of the figure [in]."""
MOST_CURVES = 6
"""Largest number of curves, one for each size of the modelling error, that are distinguishable."""


def _drawn(found: TauLimits, *, shown: bool) -> Figure:
    """A figure with two adjacent panels; ``shown`` as in ``new_figure``."""
    from barbalat.pictures.theme import WIDE, Theme, dash_of, new_figure

    figure = new_figure(WIDE, FIGURE_HEIGHT, shown=shown, layout="constrained")
    limits, errors = figure.subplots(1, 2)
    theme, lost = Theme.current(), found.loses > 0
    limits.plot(found.sizes, found.tolerates, "o-", color=theme.colour(0), markersize=4, label="smallest tau tolerated")
    limits.plot(
        found.sizes[lost], found.loses[lost], "x", color=theme.colour(1), markersize=6, label="largest tau below it that is lost"
    )
    _set_up(limits, "Lower limit on tau", "size of the modelling error", "tau")
    chosen = np.unique(np.linspace(0, len(found.sizes) - 1, min(len(found.sizes), MOST_CURVES)).round().astype(int))
    for k, i in enumerate(chosen):
        errors.plot(
            found.taus, found.tail[i], linestyle=dash_of(k), marker="o", color=theme.colour(k), markersize=3,
            label=f"size {found.sizes[i]:.3g}",
        )  # fmt: skip
    _set_up(errors, "Error where tau is tolerated", "tau", "largest |e| in the tail")
    return figure


def _set_up(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set(xscale="log", yscale="log")
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.tick_params(labelsize=9)
    axes.grid(visible=True, linewidth=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(title=title, loc="lower left", bbox_to_anchor=(-0.01, 1.0), ncols=3, frameon=False, fontsize=9, alignment="left")
