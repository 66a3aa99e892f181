"""The certificate of the standard MRAC (3)-(4): the bound (9), and its column of Table 1."""

from __future__ import annotations

from typing import Any

from barbalat.certificates.assumptions import FROZEN_LAW, beyond_the_paper, exact_plant, measured, theta_in_the_set
from barbalat.certificates.bounds import disturbed, known_command, laws, theorem_1
from barbalat.certificates.bounds.model import model_bounds
from barbalat.certificates.cells import estimate, limits_text, margins_cell, nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption, Entry
from barbalat.certificates.grounds import of_lyapunov_law
from barbalat.certificates.linear_loops.margin_values import add_adapting_margins
from barbalat.certificates.rows import up
from barbalat.certificates.schemes import midpoint
from barbalat.certificates.schemes.state_feedback import (
    add_ingredients,
    add_margins_at_rest,
    add_no_bound_over_the_set,
    add_parameter_errors,
    carried,
    commands_and_gains,
    lyapunov_estimates,
    of_lyapunov_law_beyond,
    of_the_case,
    of_the_lyapunov_law,
    unproven_robustness,
)
from barbalat.certificates.step_limits import any_regressor, frozen_laws
from barbalat.certificates.step_limits.oscillator import HeldOscillator
from barbalat.controllers import Mrac
from barbalat.problem.state_feedback import Problem
from barbalat.solvers.simulation import Simulation

ESTIMATES_STATEMENT = "V never grows; if phi is persistently exciting, which is not checked here, the estimates converge to theta"


def certificate(problem: Problem, controller: Mrac, simulation: Simulation) -> Certificate:
    """The bound (9), the limits on gain and step, the margins of the linear loops."""
    if beyond_the_paper(problem):
        return of_lyapunov_law_beyond(_excited(problem, controller), simulation)
    equations, draft = controller.bind(problem.known), Draft()
    model = model_bounds(problem)
    add_parameter_errors(draft, problem, equations)
    rests_on = of_the_case(problem, equations.estimate_set, acting=carried(problem, controller))
    level, void = disturbed.level(problem, controller, draft["nu_0"]), laws.why_no_bound(controller, problem)
    if void is not None:
        draft.missing("error_bound", void, *rests_on, theorem=laws.theorem_of_modified(controller, problem))
        add_no_bound_over_the_set(draft, problem, void)
    else:
        draft.guarantee("error_bound", level.value, *rests_on)
        nu_0_worst = draft.get("nu_0_worst")
        if nu_0_worst is not None and not level.pushed:
            worst = theorem_1.mrac_bound(nu_0_worst, laws.least_gain(controller.gamma))
            draft.guarantee("error_bound_worst", worst, *rests_on, theta_in_the_set(problem))
            command = known_command.of_adapting(problem, problem.known, controller.gamma, equations.theta_hat0)
            draft.guarantee(known_command.KEY, command, *rests_on, theta_in_the_set(problem))
        elif level.pushed:
            add_no_bound_over_the_set(draft, problem)
    add_ingredients(draft, problem, equations.estimate_set, model)
    limits = frozen_laws.of_lyapunov_law(problem, controller.gamma, simulation, model.x_m_euclidean + level.pushed, level.nu)
    draft.estimate(frozen_laws.with_modifications(limits, controller, simulation), FROZEN_LAW)
    if not laws.is_modified(controller):
        draft.estimate(frozen_laws.of_the_motion(problem, controller.gamma, simulation), FROZEN_LAW)
    add_margins_at_rest(draft, problem)
    add_adapting_margins(draft, problem, controller)
    return draft.finish()


def _excited(problem: Problem, controller: Mrac) -> any_regressor.Excited:
    return any_regressor.Excited(problem, controller, divides_by_gain=True)


def grounds(problem: Problem, controller: Mrac, _: Simulation) -> dict[str, Any]:
    """The numbers of Theorem 1 (i)."""
    equations, carries = controller.bind(problem.known), disturbed.is_disturbed(problem)
    return of_lyapunov_law("mrac", equations, controller.gamma, problem.known, controller, carries=carries)


def held_limits(problem: Problem, controller: Mrac, simulation: Simulation, nu_0: float) -> dict[str, Any]:
    """gamma_max and step_max of the sampled law, for |x| within the bounds on model and e, and for the motion of the model."""
    held = HeldOscillator(problem.known)
    if beyond_the_paper(problem):
        excited = _excited(problem, controller)
        limits = any_regressor.of_lyapunov_law(excited, simulation, nu_0, oscillator=held)
        return limits | any_regressor.of_lyapunov_law_at_model(excited, simulation, oscillator=held)
    reach = model_bounds(problem).x_m_euclidean
    values = frozen_laws.of_lyapunov_law(problem, controller.gamma, simulation, reach, nu_0, oscillator=held)
    if laws.is_modified(controller):
        return frozen_laws.with_modifications(values, controller, simulation)
    return values | frozen_laws.of_the_motion(problem, controller.gamma, simulation, held)


def midpoint_form(problem: Problem, controller: Mrac, sample_time: float) -> midpoint.MidpointForm:
    """Return the properties that the sampled MRAC preserves; it has no filter between its fast estimates and the input."""
    return midpoint.of_predictor(problem, controller, *one_sample_of_delay(problem, sample_time))


def one_sample_of_delay(problem: Problem, sample_time: float) -> tuple[str, ...]:
    """What is known about the delay that such a controller tolerates; nothing for a plant or a measurement with additions."""
    if problem.input_gain is not None or exact_plant(problem).broken or measured(problem).broken:
        return ()
    return (
        f"without input dynamics, limits, another delay and a sensor's lag, and with a known input gain, a high gain of the law "
        f"and short samples, its loop inside the known set tolerates a delay of one sample, {sample_time:g} s, at the plant's "
        f"input. With a longer delay, the estimates swing between their bounds, and no bound on e is proven",
    )


def column(problem: Problem, controller: Mrac, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    return "standard MRAC (3)-(4)", cells(problem, controller, certificate)


def cells(problem: Problem, controller: laws.ModifiedScheme, certificate: Certificate) -> dict[str, Entry]:
    """The cells, which also apply to L1-AC with C = 1, because the two coincide."""
    void = laws.why_no_bound(controller, problem)
    rests_on = of_the_lyapunov_law(problem, controller, certificate)
    found = lyapunov_cells(problem, certificate, rests_on, "nu_0/sqrt(Gamma) = ", ", (9)")
    estimates = lyapunov_estimates(problem, controller, certificate, bounded=True)
    found |= {"estimates": estimates, "modelling_error": unproven_robustness(problem, controller)}
    return found if void is None else found | {"tracking": nothing("tracking", void)}


def lyapunov_cells(
    problem: Problem, certificate: Certificate, rests_on: tuple[Assumption, ...], formula: str = "", source: str = ""
) -> dict[str, Entry]:
    """The cells that follow from a Lyapunov function of error and estimates; ``formula`` and ``source`` belong to the bound on
    e."""
    bound, worst = certificate.entry("error_bound"), certificate.entry("error_bound_worst")
    transient = nothing("transient", "no bound is known" if bound is None else bound.why)
    if bound is not None and bound.applies and bound.value is not None:
        said = (", for every d within the case's bound", "") if disturbed.is_disturbed(problem) else (source, formula)
        text = f"|e| <= {said[1]}{up(bound.value)} at all times{said[0]}"
        if worst is not None and worst.applies:
            text += f"; {up(worst.value)} for the worst theta of the known set"
        text += known_command.told(certificate)
        transient = statement("transient", text, *bound.rests_on)
    falls = "the bound falls with 1/sqrt(Gamma); " if transient.applies and not disturbed.is_disturbed(problem) else ""
    commands, both = commands_and_gains(problem)
    stands_on = bound.rests_on if bound is not None and bound.kind == "guaranteed" else rests_on
    return {
        "stability": statement("stability", f"for {both}", *stands_on),
        "tracking": statement("tracking", f"converges to zero for {commands}", *rests_on),
        "transient": transient,
        "estimates": statement("estimates", ESTIMATES_STATEMENT, *rests_on),
        "modelling_error": nothing("modelling_error", "boundedness of x is not known without normalisation"),
        "tuning": estimate("tuning", falls + limits_text(certificate)),
        "margins": margins_cell(certificate),
    }
