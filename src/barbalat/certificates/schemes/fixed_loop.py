"""What is certain of any linear controller on the family (1): its own bound of the error, in Theorem 1's form, and mu.

With theta = theta_0 the loop is the model, so that e = T(s)[(theta - theta_0)'x] with e(0) = 0 and T from a matched disturbance
to x in the loop with theta_0. With N = ||T||_1 and d = max |theta - theta_0|_1 over the known set, N d < 1 gives

    ||e||_inf <= N d ||x_m||_inf / (1 - N d),

which is (10) with T in the place of W_b (1 - C), no parameter error to forget, and k_0 r not filtered.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from barbalat.certificates import theorems
from barbalat.certificates.assumptions import FREQUENCIES_TRIED, constant_in_the_end, nominal, theta_in_the_set
from barbalat.certificates.bounds import theorem_1
from barbalat.certificates.bounds.model import ModelBounds, model_bounds
from barbalat.certificates.cells import advice, estimate, margins_cell, nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import NUMBERS_ALONE, Assumption, Entry
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.margin_values import add_margins
from barbalat.certificates.linear_loops.over_known_set import robustness
from barbalat.certificates.linear_loops.worst_case import LoopsOverTheta
from barbalat.certificates.rows import up
from barbalat.certificates.schemes.output_feedback import NEGLIGIBLE_STEADY_ERROR
from barbalat.linear.enclosure import Enclosure
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.systems import StateSpace, TransferFunction, sensitivity
from barbalat.problem.state_feedback import Problem
from barbalat.validate import Array, InputError

ONE_LINEAR_INPUT = "a bound is known for one input with phi(x) = x"


@dataclass(frozen=True, eq=False, kw_only=True)
class FixedLoop:
    """A linear controller's loop, broken at the plant's input, from v to -u; the plant's states come first.

    at          the loop on the plant with a theta and an input of the gain 1
    theta_0     with which plant and controller are the model
    norm        what N is the norm of, in words and as the certificate's key
    own         what the bound rests on beside the plant (1)
    integrates  what makes a constant disturbance vanish, where T(0) = 0
    gain        of the input, where the scheme assumes one; ``own`` then says whether it is the plant's
    unmodelled  W(s), the size of the unmodelled dynamics that mu is computed for
    """

    at: Callable[[Array], StateSpace]
    theta_0: Array
    norm: str
    own: tuple[Assumption, ...]
    integrates: str
    gain: float | None = None
    unmodelled: TransferFunction | None = None

    def nominal_response(self) -> StateSpace:
        """S(s) with theta_0; its first states are the plant's response to a matched disturbance."""
        return sensitivity(self.amplified(self.theta_0))

    def amplified(self, theta: Array) -> StateSpace:
        """The loop with the gain of the input in what is fed back, so that a disturbance still enters beside it."""
        loop = self.at(theta)
        return loop if self.gain is None else StateSpace(loop.A, loop.B, self.gain * loop.C, self.gain * loop.D)

    def error_norm(self) -> Enclosure:
        """N; InputError where the loop with theta_0 is unstable."""
        S, n = self.nominal_response(), len(self.theta_0)
        if not np.linalg.eigvals(S.A).real.max() < 0:
            raise InputError("the linear loop is unstable with the nominal parameters: no bound of the error exists")
        return l1_norm(S.A, S.B[:, None], np.eye(n, len(S.A)), np.zeros((n, 1)))

    def rests_on(self, problem: Problem) -> tuple[Assumption, ...]:
        """What the bound of the error rests on."""
        return (*nominal(problem, gain_adapted=self.gain is not None), *self.own, theta_in_the_set(problem))


def add_loop(draft: Draft, problem: Problem, loop: FixedLoop) -> None:
    """The error's bound in Theorem 1's form, margins and peaks on the true plant, mu of the family."""
    known_set = problem.uncertainty
    if known_set is not None:
        _add_bound(draft, problem, loop, known_set.farthest_1(loop.theta_0))
    add_margins(draft, problem, loop.at(problem.plant.theta), "with the true parameters")
    over_known_set.add_fixed(
        draft, problem, LoopsOverTheta(problem.plant, lambda plant: loop.at(plant.theta), problem.sensor_lag)
    )
    centre = problem.plant.theta if known_set is None else known_set.middle
    draft.estimate(robustness(loop.amplified(centre), known_set, loop.unmodelled, draft.notes), FREQUENCIES_TRIED)


def _add_bound(draft: Draft, problem: Problem, loop: FixedLoop, d: float) -> None:
    try:
        condition, x_m = theorem_1.small_gain(loop.error_norm(), d), model_bounds(problem).x_m
    except InputError as error:
        draft.missing("error_bound", str(error), *loop.rests_on(problem), theorem=theorems.LINEAR_UNSTABLE)
        return
    error_bound = theorem_1.l1_bound(0.0, 1.0, condition, d, 0.0, ModelBounds(0.0, x_m, x_m))
    draft.guarantee("norms", {loop.norm: condition.norm.ends}, NUMBERS_ALONE)
    found = {"of": loop.norm, "value_upper": condition.value_upper, "limit": 1.0, "holds": condition.holds}
    draft.guarantee("condition", found, NUMBERS_ALONE)
    if condition.holds:
        draft.guarantee("error_bound", error_bound, *loop.rests_on(problem))
    else:
        why = f"||{loop.norm}||_1 times the set's radius is not below 1"
        draft.missing("error_bound", why, *loop.rests_on(problem), theorem=theorems.LINEAR_SMALL_GAIN)


def cells(problem: Problem, loop: FixedLoop | None, certificate: Certificate) -> dict[str, Entry]:
    """Return the cells of Table 1; the loop is not known for a plant with several inputs or another regressor."""
    values, bound = certificate.values, certificate.entry("error_bound")
    condition, mu = values.get("condition"), values.get("mu_parameters")
    norm = "" if loop is None else loop.norm
    small_gain = "" if condition is None else f"||{norm}||_1 times the set's radius <= {up(condition['value_upper'])}"
    robustly = (
        "see its margins"
        if mu is None
        else (f"mu over the known set = {mu:.4g}, below 1 where every constant theta in it is stable")
    )
    if bound is None or bound.value is None or loop is None:
        nothing_to_cover = ONE_LINEAR_INPUT if loop is None else "without a known set there is nothing to cover"
        why = small_gain or (nothing_to_cover if bound is None else bound.why)
        rests_on = () if loop is None else loop.rests_on(problem)
        stability, transient = nothing("stability", why, *rests_on), nothing("transient", "no bound: " + why, *rests_on)
    else:
        stability = statement("stability", small_gain, *loop.rests_on(problem))
        transient = statement("transient", f"|e| <= {up(bound.value)} at all times", *loop.rests_on(problem))
    return {
        "stability": stability,
        "tracking": _tracking(problem, loop, stability),
        "transient": transient,
        "estimates": advice("estimates", "it estimates nothing"),
        "modelling_error": estimate("modelling_error", robustly),
        "tuning": advice("tuning", "no adaptive gain"),
        "margins": margins_cell(certificate),
    }


def _tracking(problem: Problem, loop: FixedLoop | None, stability: Entry) -> Entry:
    """The error goes to zero with T(0) = 0 where r comes to rest: lim sup |e'| <= N d lim sup |e'|, so that x' vanishes."""
    if not stability.applies or loop is None:
        return nothing("tracking", stability.why)
    S, constant = loop.nominal_response(), constant_in_the_end(problem)
    left = np.abs(np.linalg.solve(S.A, S.B)[: problem.known.n]).max()
    if constant.broken or left > NEGLIGIBLE_STEADY_ERROR:
        return nothing("tracking", "not to zero in general: what theta - theta_0 adds is attenuated, not estimated")
    integrator = Assumption(loop.integrates)
    return statement("tracking", "converges to zero for the case's r", *loop.rests_on(problem), integrator, constant)
