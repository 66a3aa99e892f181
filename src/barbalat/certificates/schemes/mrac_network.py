"""The certificate of the MRAC with a network: bounded by its modification, with numbers where the case allows; Table 1's column.

No weights are known to be the ideal ones, so nothing rests on how well the network approximates: see ``bounds.network``. For a
plant that the model's feedback alone does not keep, no number is known.
"""

from __future__ import annotations

from barbalat.certificates.assumptions import ACTS_CONTINUOUSLY, START_TOGETHER, bounded_command, exact_plant, measured
from barbalat.certificates.bounds.network import bounds, control_bound
from barbalat.certificates.cells import denied, estimate, limits_text, margins_cell, nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption, Entry
from barbalat.certificates.quantities import Form, Quantity
from barbalat.certificates.rounding import up
from barbalat.certificates.schemes.unregistered import add_linearised
from barbalat.controllers.mrac_network import Equations, NetworkMrac
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import BoundedSignal
from barbalat.solvers.simulation import Simulation

OWN_QUANTITIES = {
    "W_hat_bound": Quantity("of every outer weight, and of the root of the sum of a neuron's squares, at all times"),
    "V_hat_bound": Quantity("of the root of the sum of all inner weights' squares, at all times"),
    "control_bound": Quantity("of every entry of |u|, at all times"),
    "V_hat0": Quantity("the initial inner weights, those of the constant 1 first", form=Form.MATRIX, timeless=True),
}
NO_WEIGHTS = "with the sigma-modification the weights are bounded where e is, and no bound of e is found"
STARTS_AT_ZERO = Assumption("W_hat(0) = 0")
WHATEVER_ACTS = (STARTS_AT_ZERO, ACTS_CONTINUOUSLY)
CORNER_AT_REST = (
    "where e'P b = 0 it rests with many weights, and the e-modification's leakage has a corner: it has no linearisation there"
)
NOT_TO_ZERO = "its modification promises no convergence of the error to zero: it stays in a set"


def certificate(problem: Problem, controller: NetworkMrac, simulation: Simulation) -> Certificate:
    """What its modification guarantees, and what its linearisations say."""
    draft, equations = Draft(own=OWN_QUANTITIES), controller.bind(problem.known)
    draft.note("the network never makes L = e'P e + |W_hat|^2/gamma + |V_hat|^2/gamma_v grow; that it helps is not proven")
    found, nominal, always = bounds(problem, equations), _nominal(problem), _of_the_weights(problem, controller)
    if found.error is None:
        draft.missing("error_bound", found.why)
    else:
        draft.guarantee("error_bound", found.error, *nominal)
    if found.W_hat is None:
        for key in ("W_hat_bound", "V_hat_bound", "control_bound"):
            draft.missing(key, NO_WEIGHTS)
    else:
        draft.guarantee("W_hat_bound", found.W_hat, *always)
        draft.guarantee("V_hat_bound", found.V_hat, *always)
        _add_control_bound(draft, problem, equations, found.W_hat, always)
    draft.advise({"V_hat0": equations.V_0.tolist()})
    if _is_e_modified(controller):
        draft.note("it rests with many weights: margins are with those nearest to the initial ones")
    add_linearised(draft, problem, controller, simulation, bent=CORNER_AT_REST if _is_e_modified(controller) else "")
    return draft.finish()


def _of_the_weights(problem: Problem, controller: NetworkMrac) -> tuple[Assumption, ...]:
    """What their bounds rest on: by the e-modification on the law alone."""
    return WHATEVER_ACTS if _is_e_modified(controller) else _nominal(problem)


def _is_e_modified(controller: NetworkMrac) -> bool:
    assert controller.leakage is not None  # the constructor has seen to it
    return controller.leakage.per_error is not None


def _add_control_bound(
    draft: Draft, problem: Problem, equations: Equations, W_hat: float, rests_on: tuple[Assumption, ...]
) -> None:
    bounded = bounded_command(problem)
    if bounded.broken:
        draft.missing("control_bound", bounded.broken)
    else:
        draft.guarantee("control_bound", control_bound(problem, equations, W_hat), *rests_on)


def _nominal(problem: Problem) -> tuple[Assumption, ...]:
    """The plant (1) with a bounded matched disturbance."""
    d = problem.disturbance
    acts = [
        ("a disturbance without a known bound", d is not None and not isinstance(d, BoundedSignal)),
        ("unmatched disturbance", bool(problem.unmatched)),
    ]
    beside = Assumption("no disturbance acts but a bounded matched one", ", ".join(word for word, there in acts if there))
    plant = exact_plant(problem), beside, measured(problem)
    return *plant, bounded_command(problem), START_TOGETHER, STARTS_AT_ZERO, ACTS_CONTINUOUSLY


def column(problem: Problem, controller: NetworkMrac, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    nominal, found = _nominal(problem), bounds(problem, controller.bind(problem.known))
    stability, transient = nothing("stability", found.why), nothing("transient", found.why)
    if found.error is not None:
        stability = statement("stability", "bounded by its modification, uniformly in time", *nominal)
        transient = statement("transient", f"|e| <= {up(found.error)} at all times", *nominal)
    estimates = nothing("estimates", NO_WEIGHTS)
    if found.W_hat is not None:
        text = f"no weights are the true ones; every outer one stays within {up(found.W_hat)}"
        estimates = statement("estimates", text, *_of_the_weights(problem, controller))
    robust = nothing("modelling_error", "that x stays bounded is known beside a bounded matched disturbance, not for Delta_m")
    e_modified = _is_e_modified(controller)
    if e_modified:
        robust = nothing("modelling_error", "weights and u stay bounded whatever acts; that x does is not known for Delta_m")
    modification = "e-modification" if e_modified else "sigma-modification"
    return f"MRAC with a network, {modification}", {
        "stability": stability,
        "tracking": denied("tracking", NOT_TO_ZERO, *nominal),
        "transient": transient,
        "estimates": estimates,
        "modelling_error": robust,
        "tuning": estimate("tuning", limits_text(certificate)),
        "margins": margins_cell(certificate),
    }
