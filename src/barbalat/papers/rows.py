"""The rows of the ledger in order: what measures each, how long that takes, and by which names they are found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from barbalat.papers.claim import Claim
from barbalat.papers.jafari_2013.figures import figures, learning
from barbalat.papers.jafari_2013.filter import bias, condition, control_oscillation, filter_margins, gain_margins, theta_size
from barbalat.papers.jafari_2013.flight import flown
from barbalat.papers.jafari_2013.linear import linear_design
from barbalat.papers.jafari_2013.numerics import numerics, onset, own_oscillation, sampled, stiff
from barbalat.papers.jafari_2013.output_feedback import output_feedback, piecewise, relative_degree
from barbalat.papers.jafari_2013.robustness import delta_2, lemma_1, robustness, theorem_2, unmodelled
from barbalat.papers.jafari_2013.section_v import Runs
from barbalat.papers.jafari_2013.tracking import any_command, does_better, l1_reference, tracking

RUNS_OF_SECTION_V = 6.0
"""Seconds that the runs take which some rows judge, about."""


@dataclass(frozen=True)
class Measurement:
    """Some of the ledger's rows.

    names    the rows' names, and what each is about in a few words: a row can be found before it is measured
    seconds  what they take in a process of their own, about: the longest are begun first, and the time that is left is forecast
    shares   a name that rows have in common which share runs: one process measures them
    ``measure`` stands alone, or judges the runs of Section V, which it is then given. ``sharper`` measures the same rows further
    than the plain command has time for, which is ``reproduce --full``; no verdict waits for it.
    """

    measure: Callable[..., Claim | list[Claim]]
    seconds: float
    names: Mapping[str, str]
    quick: bool = False
    judges_runs: bool = False
    sharper: Callable[..., Claim | list[Claim]] | None = None
    sharper_seconds: float = 0.0
    shares: str = ""

    def rows(self, *runs: Runs, full: bool = False) -> list[Claim]:
        """The rows that this measurement fills, measured now."""
        measure = self.sharper if full and self.sharper else self.measure
        found = measure(*runs)
        return [found] if isinstance(found, Claim) else found

    def duration(self, *, full: bool = False) -> float:
        """About how many seconds the rows take."""
        return self.sharper_seconds if full and self.sharper else self.seconds

    def as_json(self) -> list[dict[str, Any]]:
        """A block for each row, without a verdict: that is measured."""
        return [{"id": name, "about": about, "seconds": self.seconds, "quick": self.quick} for name, about in self.names.items()]


LEDGER = (
    Measurement(figures.as_described, 0.1, {"figures-2-5": "Figures 2 to 5 look as described"}, quick=True, judges_runs=True),
    Measurement(
        figures.without_projection, 0.1, {"no-projection": "boundedness is the projection's doing"}, quick=True, judges_runs=True
    ),
    Measurement(figures.erratum_claim, 0.1, {"erratum-14": "the sign of W_c0 in (14)"}, quick=True, judges_runs=True),
    Measurement(
        tracking.bound_9, 0.6, {"bound-9": "the standard MRAC's bound (9)"}, quick=True,
        sharper=tracking.bound_9_further, sharper_seconds=6.0,
    ),
    Measurement(
        tracking.bound_10, 0.8, {"bound-10": "L1-AC's bound (10)"}, quick=True,
        sharper=tracking.bound_10_further, sharper_seconds=8.0,
    ),
    Measurement(bias.bias_is_proportional, 0.1, {"bias-kappa": "the filter's steady error"}, quick=True),
    Measurement(tracking.best_at_zero, 0.2, {"best-kappa-zero": "the bound (10) is best without a filter"}, quick=True),
    Measurement(tracking.constant_command, 0.4, {"constant-command": "errors for constant r"}, quick=True),
    Measurement(tracking.is_mrac, 0.2, {"filtered-mrac": "L1-AC with C = 1 is the standard MRAC"}, quick=True),
    Measurement(condition.condition, 0.4, {"kappa-0.05": "for which kappa the condition holds"}, quick=True),
    Measurement(
        theta_size.filter_limits_theta, 1.6, {"filter-limits-theta": "the filter limits the size of the unknown parameters"}
    ),
    Measurement(
        numerics.come_and_go, 0.1, {"numerical-oscillation": "the oscillations are numerical"}, quick=True, judges_runs=True
    ),
    Measurement(onset.boundary, 6.0, {"boundary": "where the oscillations begin"}, judges_runs=True),
    Measurement(
        numerics.without_filter, 0.2, {"oscillation-without-filter": "the filter does not cause the oscillations"}
    ),
    Measurement(numerics.smaller_gain, 0.2, {"smaller-gain": "a smaller gain removes the oscillations"}),
    Measurement(numerics.small_tau, 0.4, {"small-tau-numerics": "a very small tau fails numerically"}),
    Measurement(
        own_oscillation.own_oscillation, 5.7, {"own-oscillation": "at h = 1e-5 s the oscillation is gone"}, shares="converged"
    ),
    Measurement(
        stiff.stiff_solvers, 12.0, {"stiff-solvers": "solvers for stiff problems"},
        sharper=stiff.stiff_solvers_further, sharper_seconds=190.0, shares="converged",
    ),
    Measurement(sampled.claim, 1.6, {"sampled-midpoint": "a sampled law that no gain destabilises"}),
    Measurement(sampled.delays, 0.9, {"sampled-delay": "sampled controllers and delays"}),
    Measurement(
        gain_margins.gain_reduces_margins, 0.7, {"gain-reduces-margins": "a high adaptive gain reduces robustness"}, shares="scans"
    ),
    Measurement(
        filter_margins.claim, 9.0, {"filter-reduces-margins": "the filter reduces the margins"}, shares="scans"
    ),
    Measurement(robustness.tau_and_error, 0.3, {"tau-error": "the robust MRAC's error is proportional to tau"}),
    Measurement(
        theorem_2.claims, 5.0,
        {
            "tau-limit-delay": "the lower limit of tau with an input delay",
            "tau-limit-mu": "the lower limit of tau with Delta_m = -mu s",
        },
    ),
    Measurement(
        lemma_1.claims, 2.5,
        {
            "lemma-1-bounded": "what Lemma 1 (i) bounds",
            "lemma-1-no-error": "Lemma 1 (ii) without modelling error",
            "lemma-1-small": "Lemma 1 (ii) with a modelling error",
        },
    ),
    Measurement(
        linear_design.claims, 7.0,
        {
            "adaptive-against-linear": "adaptive schemes against linear robust designs",
            "l1-against-pi": "L1-AC against a PI controller",
        },
    ),
    Measurement(
        learning.loss_of_learning, 0.1, {"loss-of-learning": "numerical instability and learning"}, quick=True, judges_runs=True
    ),
    Measurement(learning.exponential, 0.5, {"exponential-convergence": "exponential convergence of the estimates"}, quick=True),
    Measurement(
        delta_2.claim, 2.0, {"delta-2-term": "what a modelling error adds to the robust MRAC's error at a fixed tau"},
        sharper=partial(delta_2.claim, full=True), sharper_seconds=3.5,
    ),
    Measurement(
        any_command.claim, 5.0, {"any-command": "the error goes to zero for any bounded command"},
        sharper=partial(any_command.claim, full=True), sharper_seconds=24.0,
    ),
    Measurement(
        unmodelled.claim, 2.0, {"unmodelled-unbounded": "projected MRAC and L1-AC beside unmodelled dynamics"},
        sharper=partial(unmodelled.claim, full=True), sharper_seconds=4.0,
    ),
    Measurement(
        control_oscillation.claim, 2.5, {"filter-control-frequency": "what the filter does to the oscillations in the control"},
        sharper=partial(control_oscillation.claim, full=True), sharper_seconds=7.5,
    ),
    Measurement(
        does_better.claim, 6.5, {"robust-mrac-better": "the robust MRAC against L1-AC in every respect"},
        sharper=partial(does_better.claim, full=True), sharper_seconds=7.0,
    ),
    Measurement(
        l1_reference.claim, 1.5, {"l1-reference-system": "L1-AC's own objective: to follow its reference system"},
        sharper=partial(l1_reference.claim, full=True), sharper_seconds=4.0,
    ),
    Measurement(output_feedback.l1_is_linear, 0.6, {"l1-output-is-lti": "the L1 output-feedback controller is linear"}),
    Measurement(piecewise.is_linear, 2.5, {"l1-piecewise-is-lti": "the L1 controller that flies is linear"}),
    Measurement(flown.claim, 0.1, {"adaptive-in-flight": "adaptive and linear control on a flight model that others made"}),
    Measurement(output_feedback.rohrs, 1.0, {"rohrs": "Rohrs' example"}),
    Measurement(
        relative_degree.claim, 4.0, {"siso-any-relative-degree": "the robust MRAC for any relative degree"},
        sharper=partial(relative_degree.claim, full=True), sharper_seconds=14.0,
    ),
)  # fmt: skip
