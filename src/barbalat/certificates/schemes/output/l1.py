"""The certificate of L1 output feedback: condition (20), the equivalent linear controller, margins, and the column of Table 1.

With G = N_g/D_g, C = N_c/D_c, G_m = m/(s + m),
    H(s) = G G_m/(C G + (1 - C) G_m) = m N_g D_c/[N_c N_g (s + m) + m (D_c - N_c) D_g],
so that H (1 - C) has m N_g (D_c - N_c) over the same denominator.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from barbalat.certificates import theorems
from barbalat.certificates.bounds.formulas import steepest_seen
from barbalat.certificates.cells import advice, estimate, limits_text, margins_cell
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import NUMBERS_ALONE, Assumption, Entry
from barbalat.certificates.grounds import of_system
from barbalat.certificates.linear_loops.margin_values import add_margins, finite, margins_of
from barbalat.certificates.quantities import Form, Quantity
from barbalat.certificates.rows import up
from barbalat.certificates.schemes.output_feedback import (
    LINEAR_LOOP,
    OF_LINEAR_LOOPS,
    SMALL_GAIN,
    add_bounds,
    add_linear_loop,
    cells_of_linear_loop,
    grounds_of_loop,
)
from barbalat.certificates.schemes.unregistered import add_step_of_modes
from barbalat.controllers.output.l1 import L1Output, LinearEquivalent, fast_limit, linear_equivalent
from barbalat.linear.enclosure import OUTWARD_FACTOR, Enclosure
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.largest import largest_from
from barbalat.linear.systems import TransferFunction
from barbalat.problem.output_feedback import OutputProblem
from barbalat.solvers import Tableau
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

OWN_QUANTITIES = OF_LINEAR_LOOPS | {
    "sigma_needed": Quantity("bound on |sigma| while the projection does not act"),
    "linear_equivalent": Quantity(
        "u = feedforward[r] - feedback[y] while sigma is inside its bounds", form=Form.TRANSFER_FUNCTIONS
    ),
    "linear_equivalent_limit": Quantity("the same for gamma -> infinity", form=Form.TRANSFER_FUNCTIONS),
    "delay_margin_limit": Quantity("the same for gamma -> infinity", "s"),
}
LIMITS_TOLERANCE = 1e-9
"""Relative accuracy of the limits on gain and step, far better than needed for an estimate."""


def small_gain_system(controller: L1Output, G: TransferFunction) -> TransferFunction:
    """H(s)(1 - C(s)) of (20)."""
    C, m = controller.filter, controller.m
    one_minus = np.polysub(C.den, C.num)
    den = np.polyadd(np.polymul(np.polymul(C.num, G.num), [1.0, m]), m * np.polymul(one_minus, G.den))
    return TransferFunction(m * np.polymul(G.num, one_minus), den)


def condition_norm(controller: L1Output, G: TransferFunction) -> Enclosure:
    """||H(1 - C)||_1; raises InputError if H is not stable."""
    system = small_gain_system(controller, G)
    if not system.is_stable:
        raise InputError(f"H(s) of (20) is not stable: a pole has real part {system.poles.real.max():.6g}")
    state_space = system.realise()
    return l1_norm(state_space.A, state_space.B[:, None], state_space.C[None], np.array([[state_space.D]]))


def certificate(problem: OutputProblem, controller: L1Output, simulation: Simulation) -> Certificate:
    """Condition (20), the bounds on y and e, the equivalent linear controller and its margins."""
    plant, draft = problem.plant.transfer_function, Draft(own=OWN_QUANTITIES)
    G = plant if controller.design_plant is None else controller.design_plant
    _add_bounds(draft, problem, controller, simulation)
    _add_condition(draft, controller, G, _lipschitz(draft, problem, controller))
    if not same_response(G, plant):
        draft.note(
            "(20) is evaluated for the design plant, which differs from the plant; the bounds and margins are for the plant"
        )
    pair = "gamma_max and step_max are those of the pair sigma, y_hat; for the loop they are estimates"
    draft.estimate({"adaptation_frequency": math.sqrt(controller.gamma * controller.m)} | _limits(controller, simulation), pair)
    add_step_of_modes(draft, problem, controller, simulation)  # a plant or filter is faster than this pair
    equivalent, tends_to = linear_equivalent(controller), fast_limit(controller)
    inside = "the controller's equivalent while sigma is inside its bounds"
    draft.exact({"linear_equivalent": _coefficients(equivalent)}, inside)
    draft.exact({"linear_equivalent_limit": _coefficients(tends_to)}, "for gamma -> infinity")
    add_margins(draft, problem, (equivalent.feedback * plant).realise(), inside, LINEAR_LOOP)
    limit = margins_of(problem, (tends_to.feedback * plant).realise(), "for gamma -> infinity", draft.notes)
    if "delay_margin" in limit:
        draft.exact({"delay_margin_limit": limit["delay_margin"]}, "for gamma -> infinity", LINEAR_LOOP)
    draft.note(
        "inside the bounds of sigma this controller is linear and has integral action, a pole at s = 0; projection stops the "
        "integrator at the bounds, which is anti-windup"
    )
    return draft.finish()


def grounds(problem: OutputProblem, controller: L1Output, simulation: Simulation) -> dict[str, Any]:
    """The numbers of the small-gain bounds, of the linear controller inside the bounds of sigma, and of H (1 - C)."""
    G = problem.plant.transfer_function if controller.design_plant is None else controller.design_plant
    facts = grounds_of_loop(problem, replace(controller, sigma_bound=None), simulation)
    draft = Draft(own=OWN_QUANTITIES)
    _add_bounds(draft, problem, controller, simulation)
    L = None if controller.lipschitz is None else _lipschitz(draft, problem, controller)
    return facts | {"H(1-C)": of_system(small_gain_system(controller, G).realise()), "lipschitz": L}


def _add_bounds(draft: Draft, problem: OutputProblem, controller: L1Output, simulation: Simulation) -> None:
    """Add bounds on y, e and sigma, for the linear controller to which the scheme reduces while sigma is inside its bounds."""
    found, limit = add_linear_loop(draft, problem, replace(controller, sigma_bound=None), simulation), controller.sigma_bound
    if found is None:
        return
    if limit is not None and found.sigma > limit:
        why = (
            f"sigma may have to reach {found.sigma:.6g}, more than sigma_bound = {limit:g}, and nothing is known while the "
            f"projection acts"
        )
        draft.all_missing(("sigma_needed", "output_bound", "error_bound"), why, theorem=theorems.SLOPE)
        return
    draft.guarantee("sigma_needed", found.sigma, *SMALL_GAIN)
    add_bounds(draft, problem, found)


def _lipschitz(draft: Draft, problem: OutputProblem, controller: L1Output) -> float | None:
    """L of (20): the given value unless f contradicts it, 0 without f, or the slope of f within the bound on y; None if L is
    unknown."""
    f, given = problem.plant.f, controller.lipschitz
    if f is None:
        return given or 0.0
    slope: float | None = draft.get("slope")
    if given is None:
        return slope
    least = steepest_seen(f, 0.0 if slope is None else draft["output_bound"])
    if least > given * OUTWARD_FACTOR:
        where = "at y = 0" if slope is None else "within the bound on y"
        draft.note(f"lipschitz = {given:g} is not a Lipschitz constant of f: the slope reaches {least:.6g} {where}")
        return least
    if slope is None:
        draft.note(f"lipschitz = {given:g} is assumed, but not shown, to bound the slope of f")
    return given


def _add_condition(draft: Draft, controller: L1Output, G: TransferFunction, L: float | None) -> None:
    """||H(1 - C)||_1 and, with L, condition (20)."""
    named = {"limit": 1.0, "of": "H (1 - C)", "times": "L"}
    of_the_limit = Assumption(
        "(20) holds for the limit gamma -> infinity and a sigma without bounds; the bounds are those for this gamma"
    )
    try:
        norm = condition_norm(controller, G)
    except InputError as error:
        draft.note(str(error))
        draft.estimate({"condition": {"value_upper": None, "holds": False} | named})
        return
    draft.guarantee("norms", (draft.get("norms") or {}) | {"H(1-C)": norm.ends}, NUMBERS_ALONE)
    if L is None:
        draft.missing("condition", "it cannot be evaluated: the plant has f(t, y), and no lipschitz is given")
        return
    upper = norm.upper * L * OUTWARD_FACTOR
    draft.guarantee("condition", {"value_upper": upper, "holds": upper < 1} | named, of_the_limit)


def same_response(one: TransferFunction, other: TransferFunction) -> bool:
    """Whether two transfer functions have the same coefficients, up to rounding."""
    return all(
        len(a) == len(b) and np.allclose(a, b, rtol=1e-12, atol=0) for a, b in ((one.num, other.num), (one.den, other.den))
    )


def _coefficients(linear: LinearEquivalent) -> dict[str, dict[str, list[float]]]:
    """Return the coefficients of u = feedforward[r] - feedback[y], highest power first."""
    return {name: {"num": system.num.tolist(), "den": system.den.tolist()} for name, system in linear._asdict().items()}


def _limits(controller: L1Output, simulation: Simulation) -> dict[str, Any]:
    """The largest gamma for this step, and the largest step for this gamma, such that the roots of s^2 + m s + gamma m stay
    within the solver's region."""
    solver, m = simulation.solver, controller.m
    gamma = largest_from(lambda value: _tolerates(solver, simulation.dt, m, value), controller.gamma, within=LIMITS_TOLERANCE)
    step = largest_from(lambda value: _tolerates(solver, value, m, controller.gamma), simulation.dt, within=LIMITS_TOLERANCE)
    return {"gamma_max": finite(gamma), "step_max": finite(step)}


def _tolerates(solver: Tableau, h: float, m: float, gamma: float) -> bool:
    poles: Array = np.roots([1.0, m, gamma * m])
    return bool((np.abs(solver.amplification(h * poles)) <= 1).all())


def linear_when(_problem: OutputProblem, _controller: L1Output) -> str | None:
    """The controller is linear inside the bounds of sigma, as in continuous time."""
    return f"{LINEAR_LOOP}; sigma is inside its bounds"


def column(problem: OutputProblem, controller: L1Output, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    values = certificate.values
    condition = values.get("condition")
    value = "unknown" if condition is None or condition["value_upper"] is None else f"<= {up(condition['value_upper'])}"
    stated = f"condition (20): ||H(1 - C)||_1 L {value}, for gamma -> infinity"
    inside = ""
    if "sigma_needed" in values:
        bound = "" if controller.sigma_bound is None else f" stays inside its bound {controller.sigma_bound:g}"
        inside = f"; |sigma| <= {up(values['sigma_needed'])}{bound}"
    return "L1 output feedback (18)-(21), a linear controller with integral action", {
        **cells_of_linear_loop(problem, certificate, inside),
        "estimates": advice("estimates", "sigma is the state of an integrator, not a parameter estimate"),
        "modelling_error": estimate("modelling_error", "the robustness of its linear loop; see the margins"),
        "tuning": estimate("tuning", f"{limits_text(certificate)}; {stated}"),
        "margins": margins_cell(certificate),
    }
