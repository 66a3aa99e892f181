"""The certificate of each controller of a problem, put together from conditions, bounds, limits and margins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from barbalat.certify import laws, limits, linear, output, over_known_set, regressor_limits, sampled, theorem1
from barbalat.certify.bound_10 import Reach, bound_10
from barbalat.certify.certificate import Certificate
from barbalat.certify.common import (
    ASSUMED,
    BEYOND,
    EXACT_START,
    FROZEN,
    IN_THE_SET,
    LINEAR,
    MATCHED,
    OF_THE_PROBLEM,
    ON_THE_BOX,
    OUTSIDE,
    TRIED,
    finish,
    parameter_errors,
)
from barbalat.certify.loop_values import adapting_margins, margins_of
from barbalat.certify.loops import fast_adaptation, known_parameters
from barbalat.closed_loop import ClosedLoop
from barbalat.controllers import L1Adaptive, LinearFeedback, Mrac, NormalizedMrac, RobustMrac, Sampled
from barbalat.grid import Simulation
from barbalat.linear import StateSpace
from barbalat.output_problem import OutputProblem
from barbalat.problem import Problem
from barbalat.protocols import Controller
from barbalat.tracking_problem import TrackingProblem
from barbalat.validate import InputError


def certify(problem: TrackingProblem, controllers: tuple[Controller, ...], simulation: Simulation) -> dict[str, Certificate]:
    """Certificates by the controllers' names; nothing is simulated."""
    return {controller.name: _certificate(problem, controller, simulation) for controller in controllers}


def certify_where_possible(
    problem: TrackingProblem, controllers: Sequence[Controller], simulation: Simulation
) -> dict[str, Certificate]:
    """The same for a report: what can't be certified has the reason as its finding."""
    found = {}
    for controller in controllers:
        try:
            found[controller.name] = _certificate(problem, controller, simulation)
        except InputError as error:
            found[controller.name] = Certificate({}, frozenset(), (), (f"no certificate: {error}",))
    return found


def _certificate(problem: TrackingProblem, controller: Controller, simulation: Simulation) -> Certificate:
    if isinstance(controller, Sampled):
        judged = sampled.judged_at(controller, simulation)
        return sampled.certificate(problem, _certificate(problem, controller.controller, judged), controller, judged)
    if isinstance(problem, OutputProblem):
        return output.certificate(problem, controller, simulation)
    assert isinstance(problem, Problem)
    plant = problem.plant
    if plant.inputs > 1 or not plant.is_linear or problem.input_gain is not None:
        return _beyond_the_paper(problem, controller, simulation)
    match controller:
        case Mrac():
            return _mrac(problem, controller, simulation)
        case L1Adaptive():
            return _l1(problem, controller, simulation)
        case RobustMrac() | NormalizedMrac():
            return _normalized(problem, controller, simulation)
        case LinearFeedback():
            return _linear(problem, controller)
    raise InputError(f"no certificate is known for {type(controller).__name__}")


def _beyond_the_paper(problem: Problem, controller: Controller, simulation: Simulation) -> Certificate:
    """Several inputs, a regressor other than x, an unknown input gain: the Lyapunov bound, which none of these changes."""
    loop = ClosedLoop.of(problem, controller)
    if loop.parameters == 0:
        return finish(problem, {}, set(), [MATCHED], [BEYOND])
    equations: Any = loop.equations
    error = theorem1.initial_parameter_error(equations.initial().theta_hat, problem.parameters)
    values: dict[str, Any] = {}
    guaranteed: set[str] = set()
    assumptions = [MATCHED, EXACT_START, "the regressor phi(x) is known", FROZEN]
    findings = [BEYOND]
    if isinstance(controller, (Mrac, L1Adaptive)):
        values["nu_0"] = theorem1.nu_0(error, problem.known)
        guaranteed = {"nu_0"}
        void = laws.why_no_bound(controller, problem)
        if void is not None:
            findings.append(void)
        elif isinstance(controller, Mrac):
            values["error_bound"] = laws.error_level(problem, controller, values["nu_0"])
            guaranteed |= {"error_bound"}
        values |= regressor_limits.of_lyapunov_law(problem, controller, simulation, values["nu_0"])
        assumptions += [ON_THE_BOX] if "error_bound" in values else [ON_THE_BOX, ASSUMED]
    elif isinstance(controller, (RobustMrac, NormalizedMrac)):
        values["initial_parameter_error"] = error
        guaranteed = {"initial_parameter_error"}
        values |= limits.of_parametric_model(problem, controller, equations, simulation)
    if equations.box is not None:
        assumptions.insert(1, IN_THE_SET)
    if problem.known.box is not None and not problem.known.box.contains(problem.parameters):
        findings.append(OUTSIDE)
    return finish(problem, values, guaranteed, assumptions, findings)


def _mrac(problem: Problem, controller: Mrac, simulation: Simulation) -> Certificate:
    loop = ClosedLoop.of(problem, controller)
    values, findings = parameter_errors(problem, loop)
    guaranteed = {"nu_0", "nu_0_worst"}
    void = laws.why_no_bound(controller, problem)
    if void is not None:
        findings.append(void)
    else:
        values["error_bound"] = laws.error_level(problem, controller, values["nu_0"])
        if "nu_0_worst" in values:
            values["error_bound_worst"] = theorem1.mrac_bound(values["nu_0_worst"], laws.least_gain(controller.gamma))
        guaranteed |= {"error_bound", "error_bound_worst"}
    equations: Any = loop.equations
    model = theorem1.model_bounds(problem)
    values |= theorem1.ingredients(problem.known, equations.box, model)
    guaranteed |= OF_THE_PROBLEM & values.keys()
    values |= limits.with_modifications(
        limits.of_lyapunov_law(problem, controller.gamma, simulation, model.x_m_euclidean, values["nu_0"]), controller, simulation
    )
    values |= _margins_at_rest(problem, findings)
    values |= adapting_margins(problem, loop, findings)
    assumptions = [MATCHED, EXACT_START, FROZEN, LINEAR]
    if equations.box is not None:
        assumptions.insert(1, IN_THE_SET)
    return finish(problem, values, guaranteed, assumptions, findings)


def _l1(problem: Problem, controller: L1Adaptive, simulation: Simulation) -> Certificate:
    known = problem.known
    loop = ClosedLoop.of(problem, controller)
    equations: Any = loop.equations
    C: StateSpace = equations.C
    values, findings = parameter_errors(problem, loop)
    guaranteed = {"nu_0", *(key for key in ("nu_0_worst",) if key in values)}
    assumptions = [MATCHED, EXACT_START, "the filter starts at rest", FROZEN, LINEAR]
    model = theorem1.model_bounds(problem)
    values |= theorem1.ingredients(known, equations.box, model)
    guaranteed |= OF_THE_PROBLEM & values.keys()
    reach = None
    if equations.box is None:
        findings.append("without projection there is no theta_max, so the condition on C(s) and the bound (10) have no meaning")
    else:
        assumptions.insert(1, IN_THE_SET)
        reach = bound_10(problem, controller, C, model, values, guaranteed, findings)
    if reach is None:  # no bound on x: take what the model asks for, and say so
        reach = Reach(model.x_m_euclidean, values["nu_0"])
        assumptions.append("|x| in the adaptation frequency is the model's bound plus nu_0/sqrt(Gamma): an estimate")
    values |= limits.with_modifications(
        limits.of_lyapunov_law(problem, controller.gamma, simulation, reach.offset, reach.factor, np.linalg.eigvals(C.A)),
        controller,
        simulation,
    )
    if controller.filter is None:
        values |= _margins_at_rest(problem, findings)
    else:
        values |= _margins_of_the_limit(problem, equations, assumptions, findings)
    values |= adapting_margins(problem, loop, findings)
    return finish(problem, values, guaranteed, assumptions, findings)


def _margins_at_rest(problem: Problem, findings: list[str]) -> dict[str, Any]:
    """Of the loop with C = 1, at the case's theta and over the known set."""
    plant = problem.plant
    values = margins_of(problem, known_parameters(plant, plant.theta), over_known_set.AT_REST, findings)
    return values | over_known_set.at_rest(problem, findings)


def _margins_of_the_limit(problem: Problem, equations: Any, assumptions: list[str], findings: list[str]) -> dict[str, Any]:
    """Margins and mu of what L1-AC tends to for fast adaptation: a linear controller with S = 1 - C at theta = 0."""
    plant, C, known_set = problem.plant, equations.C, equations.box
    values = margins_of(problem, fast_adaptation(plant, C), over_known_set.FAST, findings)
    values |= over_known_set.filtered(problem, C, findings)
    if known_set is not None:
        at_centre = fast_adaptation(replace(plant, theta=known_set.middle), C)
        values |= linear.robustness(at_centre, known_set, None, findings)
        assumptions.append(f"{TRIED}; its loop is the limit of fast adaptation inside the projection bounds")
    return values


def _normalized(problem: Problem, controller: RobustMrac | NormalizedMrac, simulation: Simulation) -> Certificate:
    """What is guaranteed is Lemma 1's boundedness and convergence; its constants are not computable from the case."""
    plant = problem.plant
    loop = ClosedLoop.of(problem, controller)
    values, findings = parameter_errors(problem, loop)
    del values["nu_0"]
    values.pop("nu_0_worst", None)
    values["initial_parameter_error"] = theorem1.initial_parameter_error(loop.equations.initial().theta_hat, plant.theta)  # type: ignore[attr-defined]
    equations: Any = loop.equations
    values |= limits.of_parametric_model(problem, controller, equations, simulation)
    values |= _margins_at_rest(problem, findings)
    if isinstance(controller, RobustMrac):
        values["tau_below"] = 1 / controller.normalization.delta_0  # Theorem 2: tau in (tau_min, 1/delta_0)
        if not controller.tau < values["tau_below"]:
            findings.append(
                f"Theorem 2 asks for tau < 1/delta_0 = {values['tau_below']:.4g} s, and tau is {controller.tau:.4g} s"
            )
    assumptions = [
        MATCHED + "; with modelling error only Theorem 2's existence statement remains",
        EXACT_START,
        "c_0 makes W_m minimum phase (checked)",
        FROZEN,
        laws.convergence(controller.law, controller.bind(problem.known).box) + "; no number bounds e",
        LINEAR,
    ]
    return finish(problem, values, {"initial_parameter_error"}, assumptions, findings)


def _linear(problem: Problem, controller: LinearFeedback) -> Certificate:
    """The error's bound in Theorem 1's form, margins and peaks on the true plant, mu of the family."""
    values, guaranteed, findings = linear.certificate_values(problem, controller)
    assumptions = [MATCHED, "x_m(0) = x(0), and K(s) starts at rest", "theta lies in the known set", TRIED]
    return finish(problem, values, guaranteed, assumptions, findings)
