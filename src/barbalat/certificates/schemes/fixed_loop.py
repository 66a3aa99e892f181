"""Guarantees for any linear controller on the family (1): a bound on the error in the form of Theorem 1, and mu.

With theta = theta_0 the loop is the model. Therefore e = T(s)[(theta - theta_0)'x] with e(0) = 0, where T is the transfer matrix
from a matched disturbance to x in the loop with theta_0. With N = ||T||_1 and d = max |theta - theta_0|_1 over the known set, N d
< 1 gives

    ||e||_inf <= N d ||x_m||_inf / (1 - N d),

which is (10) with T in place of W_b (1 - C), without an initial parameter error, and with unfiltered k_0 r.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from barbalat.certificates import theorems
from barbalat.certificates.assumptions import FREQUENCIES_TRIED, constant_in_the_end, nominal, of_linear_loop, theta_in_the_set
from barbalat.certificates.bounds import any_command, known_command, theorem_1
from barbalat.certificates.bounds.model import ModelBounds, model_bounds
from barbalat.certificates.cells import advice, estimate, margins_cell, nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import NUMBERS_ALONE, Assumption, Entry
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.margin_values import add_margins
from barbalat.certificates.linear_loops.over_known_set import robustness
from barbalat.certificates.linear_loops.over_ranges import MARGINS_KEY
from barbalat.certificates.requested_keys import is_left_out, is_needed
from barbalat.certificates.rows import up
from barbalat.certificates.schemes import bounded_response
from barbalat.certificates.schemes.output_feedback import NEGLIGIBLE_STEADY_ERROR
from barbalat.linear.enclosure import Enclosure
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.systems import StateSpace, TransferFunction, sensitivity
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.validate import Array, InputError

NOT_OVER_THE_SET = "no bound is known for the whole known set"
ONE_LINEAR_INPUT = "a bound is known only for one input with phi(x) = x"


@dataclass(frozen=True, eq=False, kw_only=True)
class FixedLoop:
    """A linear controller's loop, broken at the plant's input, from v to -u; the plant's states come first.

    at          the loop for the plant with a theta and an input gain of 1
    theta_0     the theta with which plant and controller form the model
    norm        the system whose norm is N, in words and as a key of the certificate
    own         assumptions of the bound in addition to the plant (1)
    integrates  what removes the effect of a constant disturbance, if T(0) = 0
    gain        gain of the input, if the scheme assumes one; ``own`` then says whether it is that of the plant
    unmodelled  W(s), the size of the unmodelled dynamics for which mu is computed
    """

    at: Callable[[Array], StateSpace]
    theta_0: Array
    norm: str
    own: tuple[Assumption, ...]
    integrates: str
    gain: float | None = None
    unmodelled: TransferFunction | None = None

    @classmethod
    def with_gain_of_1(
        cls, problem: Problem, *, at: Callable[[Array], StateSpace], own: tuple[Assumption, ...] = (), **rest: Any
    ) -> FixedLoop:
        """The loop of a controller that assumes an input gain of 1, as the certificate does if the gain is unknown."""
        if problem.input_gain is None:
            return cls(at=at, own=own, **rest)
        omega = float(problem.plant.paths[0].gain)
        other = "" if omega == 1 else f"input gain {omega:g}, which the controller assumes to be 1"
        return cls(at=at, own=(*own, Assumption("the input's gain is 1", other)), gain=1.0, **rest)

    def nominal_response(self) -> StateSpace:
        """S(s) with theta_0; its first states are the plant's response to a matched disturbance."""
        return sensitivity(self.amplified(self.theta_0))

    def amplified(self, theta: Array) -> StateSpace:
        """The loop with the input gain applied only to the feedback, so that a disturbance still enters unscaled."""
        loop = self.at(theta)
        return loop if self.gain is None else StateSpace(loop.A, loop.B, self.gain * loop.C, self.gain * loop.D)

    def error_norm(self) -> Enclosure:
        """N; raises InputError if the loop with theta_0 is unstable."""
        S, n = self.nominal_response(), len(self.theta_0)
        if not np.linalg.eigvals(S.A).real.max() < 0:
            raise InputError("the linear loop is unstable with the nominal parameters: no error bound exists")
        return l1_norm(S.A, S.B[:, None], np.eye(n, len(S.A)), np.zeros((n, 1))).of_rounded_system()

    def known_loop(self) -> known_command.KnownLoop:
        """e = T[(theta - theta_0)'x]."""
        S = self.nominal_response()
        return known_command.KnownLoop(S.A, S.B, self.theta_0, 0.0, self.error_norm().upper)

    def rests_on(self, problem: Problem) -> tuple[Assumption, ...]:
        """The assumptions of the bound on the error."""
        plant = nominal(problem, gain_adapted=self.gain is not None)
        return of_linear_loop(*plant, *self.own, theta_in_the_set(problem))


def add_loop(draft: Draft, problem: Problem, loop: FixedLoop, controller: Controller, t_end: float) -> None:
    """Add the bound on the error in the form of Theorem 1 or, where that does not apply, for the case's loop; margins and peaks
    for the true plant; mu of the family."""
    known_set = problem.uncertainty
    if known_set is not None:
        _add_bound(draft, problem, loop, known_set.farthest_1(loop.theta_0), t_end)
    bounded_response.add_continuous(draft, problem, controller)
    assumed = problem.input_gain is not None and loop.gain is not None and not is_left_out(MARGINS_KEY)
    if assumed and not bounded_response.is_for_the_case(draft.entries.get("error_bound")):
        draft.note(
            f"bounds on e hold for the input gain {loop.gain:g} that the controller assumes, not for all of "
            "uncertainty.input_gain; margins over the known set hold for this whole interval"
        )
    add_margins(draft, problem, loop.at(problem.plant.theta), "with the true parameters")
    over_known_set.add_fixed(draft, problem, lambda plant: loop.at(plant.theta))
    centre = problem.plant.theta if known_set is None else known_set.middle
    draft.estimate(robustness(loop.amplified(centre), known_set, loop.unmodelled, draft.notes), FREQUENCIES_TRIED)


def _add_bound(draft: Draft, problem: Problem, loop: FixedLoop, d: float, t_end: float) -> None:
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
        if is_needed(any_command.KEY, known_command.KEY):
            any_command.add(draft, problem, loop.known_loop(), loop.rests_on(problem))
        if is_needed(known_command.KEY):
            known_command.add(draft, problem, loop.known_loop(), t_end, loop.rests_on(problem))
    else:
        why = f"||{loop.norm}||_1 times the set's radius is not below 1"
        draft.missing("error_bound", why, *loop.rests_on(problem), theorem=theorems.LINEAR_SMALL_GAIN)


def cells(problem: Problem, loop: FixedLoop | None, certificate: Certificate) -> dict[str, Entry]:
    """Return the cells of Table 1; the loop is unknown for a plant with several inputs or a different regressor."""
    values, bound = certificate.values, certificate.entry("error_bound")
    case_s = bounded_response.is_for_the_case(bound)
    condition, mu = values.get("condition"), values.get("mu_parameters")
    norm = "" if loop is None else loop.norm
    small_gain = "" if condition is None else f"||{norm}||_1 times the set's radius <= {up(condition['value_upper'])}"
    robustly = (
        "see its margins"
        if mu is None
        else (f"mu over the known set = {mu:.4g}; below 1, every constant theta in the set is stable")
    )
    rests_on = () if loop is None else loop.rests_on(problem)
    if loop is None or condition is None or not condition["holds"]:
        nothing_to_cover = ONE_LINEAR_INPUT if loop is None else "there is no known set to cover"
        why = small_gain or (nothing_to_cover if bound is None or problem.uncertainty is None else bound.why or NOT_OVER_THE_SET)
        stability, transient = nothing("stability", why, *rests_on), nothing("transient", "no bound: " + why, *rests_on)
    else:
        stability = statement("stability", small_gain, *rests_on)
        transient = nothing("transient", "no bound: " + ("" if bound is None else bound.why), *rests_on)
        if bound is not None and bound.value is not None and not case_s:
            text = f"|e| <= {up(bound.value)} at all times{known_command.told(certificate)}"
            transient = statement("transient", text, *rests_on)
    return {
        "stability": stability,
        "tracking": _tracking(problem, loop, stability),
        "transient": transient,
        "estimates": advice("estimates", "it estimates nothing"),
        "modelling_error": estimate("modelling_error", robustly),
        "tuning": advice("tuning", "no adaptive gain"),
        "margins": margins_cell(certificate),
    } | (bounded_response.cells(certificate) if case_s else {})


def _tracking(problem: Problem, loop: FixedLoop | None, stability: Entry) -> Entry:
    """The error converges to zero if T(0) = 0 and r becomes constant: lim sup |e'| <= N d lim sup |e'|, so x' vanishes."""
    if not stability.applies or loop is None:
        return nothing("tracking", stability.why)
    S, constant = loop.nominal_response(), constant_in_the_end(problem)
    left = np.abs(np.linalg.solve(S.A, S.B)[: problem.known.n]).max()
    if constant.broken or left > NEGLIGIBLE_STEADY_ERROR:
        return nothing(
            "tracking", "e does not converge to zero in general: the effect of theta - theta_0 is attenuated, not estimated"
        )
    integrator = Assumption(loop.integrates)
    return statement("tracking", "converges to zero for the case's r", *loop.rests_on(problem), integrator, constant)
