"""The certificate of the direct MRAC: the bounds from its Lyapunov function, and its column of Table 1.

With k = (k_x, k_r), z = (-phi, r) and the input's gain omega > 0, e' = A_m e + b omega (k_hat - k)'z. The law makes V = e'P e +
omega [k_x_tilde'Gamma^-1 k_x_tilde + k_r_tilde^2/gamma_r] fall by |e|^2, so lambda_min(P) |e|^2 <= V(0) at all times. With
several inputs, each with an omega_i > 0, e' = A_m e + b diag(omega) (K_hat - K)'z. In V, omega_i multiplies the term of the gains
that are adapted for the input i. V(0) is a sum of squares of linear functions divided by omega, so it is convex in (theta,
omega). Its largest value over a known set and an interval of omega is at an end of the interval.

With bounded disturbances and both gains projected, V' <= -q |e|^2 + 2 p |e| as in ``bounds/disturbed``; the contribution of the
gains to V is at most its largest value over their sets.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from barbalat.certificates.assumptions import FROZEN_LAW, nominal, theta_in_the_set
from barbalat.certificates.bounds import disturbed, known_command, laws
from barbalat.certificates.bounds.formulas import largest_square
from barbalat.certificates.bounds.model import largest_along_the_command, model_bounds, require_lyapunov, state_bounds
from barbalat.certificates.cells import statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import NUMBERS_ALONE, Assumption, Entry
from barbalat.certificates.grounds import carried, plain
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.ideal import known_parameters
from barbalat.certificates.linear_loops.margin_values import add_margins
from barbalat.certificates.quantities import Quantity
from barbalat.certificates.requested_keys import is_needed
from barbalat.certificates.schemes.mrac import lyapunov_cells
from barbalat.certificates.schemes.state_feedback import (
    KNOWN_REGRESSOR,
    add_no_bound_over_the_set,
    bounded_regressor,
    carried_along,
)
from barbalat.certificates.schemes.unregistered import add_adapting, add_linearised
from barbalat.certificates.step_limits import frozen_laws
from barbalat.certificates.step_limits.oscillator import Oscillator
from barbalat.controllers.control_gains import ControlGains, feedforward_gain
from barbalat.controllers.mrac_direct import DirectMrac
from barbalat.linear.conditions import smallest_eigenvalue
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.problem.known_set import Gain, KnownSet
from barbalat.problem.state_feedback import Problem
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

MOST_INTERVALS = 10
"""Largest number of intervals: V(0) is evaluated with every input gain at an end of its interval, in up to a thousand
combinations."""
OWN_QUANTITIES = {
    "k_x": Quantity("the ideal feedback gains theta/omega", timeless=True),
    "k_r": Quantity("the ideal feedforward gain k_0/omega", timeless=True),
}
AT_REST = "with the gains fixed at their ideal values"
BOTH_GAINS = "gamma_max is the limit on Gamma when gamma_r is scaled in proportion"
ESTIMATES = (
    "V never grows; if phi and r together are persistently exciting, which is not checked here, the estimates converge to "
    "theta/omega and k_0/omega"
)


def certificate(problem: Problem, controller: DirectMrac, simulation: Simulation) -> Certificate:
    """The bound on e, the limits on gain and step, the margins with the gains fixed at their ideal values."""
    draft, gains = Draft(own=OWN_QUANTITIES), controller.bind(problem.known).gains
    require_lyapunov(problem.known)
    if gains.inputs > 1:
        return _of_several(draft, problem, controller, gains, simulation)
    theta, omega, k_0 = problem.plant.theta, _omega(problem), float(problem.model.k_0)
    draft.advise({"k_x": (theta / omega).tolist(), "k_r": k_0 / omega})
    bound = _with_disturbances(problem, gains) or _error_level(problem, gains, omega)
    rests_on = _rests_on(problem, gains, bound, _acting(problem, gains))
    draft.guarantee("error_bound", bound, *rests_on)
    _add_worst(draft, problem, gains, rests_on)
    _add_limits(draft, problem, controller, simulation, bound)
    if problem.plant.is_linear:
        add_margins(draft, problem, known_parameters(problem.plant, theta / omega), AT_REST)
        over_known_set.add_at_rest(draft, problem, gain_estimated=True)
        add_adapting(draft, problem, controller)
    return draft.finish()


def grounds(problem: Problem, controller: DirectMrac, _: Simulation) -> dict[str, Any]:
    """The numbers of V, including the input gains."""
    gains = controller.bind(problem.known).gains
    return {
        "scheme": "mrac-direct",
        "P": problem.known.P.tolist(),
        "theta_hat0": gains.theta_hat0.tolist(),
        "k_r0": gains.k_r0.tolist(),
        "gamma": plain(gains.gamma.value),
        "gamma_r": gains.gamma_r,
        "projection": gains.estimate_set is not None or gains.interval is not None,
    } | ({"carried": carried(gains.gamma.value, problem.known)} if disturbed.is_disturbed(problem) else {})


def _of_several(
    draft: Draft, problem: Problem, controller: DirectMrac, gains: ControlGains, simulation: Simulation
) -> Certificate:
    """The bound on e, and the results for the linearised loop."""
    theta, omega = problem.plant.theta, _each_omega(problem)
    k_x, k_r, m = gains.ideal(theta, omega), gains.ideal_feedforward(omega), gains.inputs
    draft.advise({"k_x": k_x.reshape(-1, m).tolist(), "k_r": k_r.reshape(m, -1).tolist()})
    of_x = np.tile(omega, len(k_x) // m) * (gains.theta_hat0 - k_x) ** 2 / gains.gamma.value
    V = math.fsum(of_x.tolist()) + _feedforward_V(gains, omega)
    bound = _with_disturbances(problem, gains) or math.sqrt(V / smallest_eigenvalue(problem.known.P)) * OUTWARD_FACTOR**2
    rests_on = _rests_on(problem, gains, bound, _acting(problem, gains))
    draft.guarantee("error_bound", bound, *rests_on)
    _add_worst(draft, problem, gains, rests_on)
    add_linearised(draft, problem, controller, simulation)
    return draft.finish()


def _omega(problem: Problem) -> float:
    return float(problem.plant.paths[0].gain)


def _each_omega(problem: Problem) -> Array:
    return np.array([path.gain for path in problem.plant.paths], dtype=float)


def _error_level(problem: Problem, gains: ControlGains, omega: float) -> float:
    """sqrt(V(0)/lambda_min(P)), rounded up, for one input."""
    off, gamma = gains.theta_hat0 - problem.plant.theta / omega, gains.gamma
    if gamma.dimensions:
        k_x_off = laws.weighted_error(off, np.asarray(gamma.value))
    else:
        k_x_off = float(np.linalg.norm(off)) / math.sqrt(gamma.value) * OUTWARD_FACTOR
    k_r_off = abs(float(gains.k_r0[0]) - float(problem.model.k_0) / omega) / math.sqrt(gains.gamma_r) * OUTWARD_FACTOR
    return math.sqrt(omega / smallest_eigenvalue(problem.known.P)) * math.hypot(k_x_off, k_r_off) * OUTWARD_FACTOR**2


def _with_disturbances(problem: Problem, gains: ControlGains) -> float | None:
    """The bound that V gives with bounded disturbances; None without disturbances, and if V gives no bound."""
    push = disturbed.push(problem, problem.known)
    if push is None or gains.estimate_set is None or gains.interval is None:
        return None
    omega, known = _each_omega(problem), problem.known
    of_x, of_r = (np.tile(omega, len(gains.theta_hat0) // gains.inputs), np.repeat(omega, len(gains.k_0) // gains.inputs))
    Gamma = laws.least_gain(gains.gamma.value) if gains.gamma.is_matrix else gains.gamma.value
    off_x = gains.estimate_set.farthest(gains.ideal(problem.plant.theta, omega), of_x / Gamma)
    off_r = gains.interval.farthest(gains.ideal_feedforward(omega), of_r / gains.gamma_r)
    radius = 2 * push / disturbed.decay(known)
    V = disturbed.largest_eigenvalue(known.P) * radius**2 + off_x**2 + off_r**2
    return math.sqrt(V / smallest_eigenvalue(known.P)) * OUTWARD_FACTOR**3


def _acting(problem: Problem, gains: ControlGains) -> Assumption:
    """The disturbances that the bound on V includes: bounded disturbances, if both gains are projected."""
    found = carried_along(problem, gains.estimate_set)
    if disturbed.is_disturbed(problem) and gains.estimate_set is not None and gains.interval is None:
        return replace(found, broken="disturbance, with a feedforward gain that is not bounded by projection")
    return found


def _add_worst(draft: Draft, problem: Problem, gains: ControlGains, rests_on: tuple[Assumption, ...]) -> None:
    """Add the largest bound over the known set, and over the intervals of the input gains if they are known."""
    known_set, interval = problem.uncertainty, problem.known.gains
    if known_set is None:
        return
    if disturbed.is_disturbed(problem):
        add_no_bound_over_the_set(draft, problem)
        return
    if interval is not None and gains.inputs > MOST_INTERVALS:
        why = f"it is computed at the ends of at most {MOST_INTERVALS} intervals of input gains"
        add_no_bound_over_the_set(draft, problem, why)
        return
    corners = [tuple(_each_omega(problem))]
    if interval is not None:
        corners = list(product(*zip(interval.lower.tolist(), interval.upper.tolist(), strict=True)))
    V = max(_largest_V(gains, known_set, np.array(omega)) for omega in corners)
    bound = math.sqrt(V / smallest_eigenvalue(problem.known.P)) * OUTWARD_FACTOR**3
    of_the_sets = theta_in_the_set(problem), _gain_in_the_interval(problem), _all_reachable(problem, gains)
    draft.guarantee("error_bound_worst", bound, *rests_on, *of_the_sets)
    command = bound * known_command.largest_component(problem.known.P, smallest_eigenvalue(problem.known.P))
    draft.guarantee(known_command.KEY, command * OUTWARD_FACTOR, *rests_on, *of_the_sets)


def _largest_V(gains: ControlGains, known_set: KnownSet, omega: Array) -> float:
    """V(0) at these input gains for the worst theta of the set."""
    of_theta = np.tile(omega, len(gains.theta_hat0) // gains.inputs)
    Gamma = laws.least_gain(gains.gamma.value) if gains.gamma.is_matrix else gains.gamma.value
    of_x = known_set.farthest(of_theta * gains.theta_hat0, 1 / (of_theta * Gamma))
    return of_x**2 + _feedforward_V(gains, omega)


def _feedforward_V(gains: ControlGains, omega: Array) -> float:
    k_r = gains.ideal_feedforward(omega)
    return math.fsum((np.repeat(omega, len(k_r) // gains.inputs) * (gains.k_r0 - k_r) ** 2 / gains.gamma_r).tolist())


def _rests_on(
    problem: Problem, gains: ControlGains, bound: float | None, acting: Assumption | None = None
) -> tuple[Assumption, ...]:
    """The assumptions: the plant (1) with any input gain, and ideal gains inside the projection set. ``acting`` is that on the
    disturbances; without it there are none."""
    regressor = () if problem.plant.is_linear else (KNOWN_REGRESSOR, bounded_regressor(problem, bound))
    corners = laws.keeps_V_in_corners(gains.gamma.value, gains.estimate_set)
    return (*nominal(problem, gain_adapted=True, acting=acting), _reachable(problem, gains), *regressor, corners)


def _reachable(problem: Problem, gains: ControlGains) -> Assumption:
    omega, estimate_set, interval = _each_omega(problem), gains.estimate_set, gains.interval
    if estimate_set is None and interval is None:
        return Assumption("the ideal gains are theta/omega and k_0/omega")
    inside = estimate_set is None or estimate_set.contains(gains.ideal(problem.plant.theta, omega))
    inside &= interval is None or interval.contains(gains.ideal_feedforward(omega))
    return Assumption(
        "the ideal gains theta/omega and k_0/omega are in the sets onto which the estimates are projected",
        "" if inside else "ideal gains outside the sets of the projection",
    )


def _all_reachable(problem: Problem, gains: ControlGains) -> Assumption:
    """The assumption that the projection set contains theta/omega for every theta of the known set; without an interval, omega is
    1."""
    if gains.estimate_set is None or problem.known.gains is not None:
        return NUMBERS_ALONE
    apart = (_each_omega(problem) != 1).any()
    return Assumption(
        "for every theta of the known set, theta/omega is in the set of the projection",
        "an input gain other than 1 without a known interval" if apart else "",
    )


def _gain_in_the_interval(problem: Problem) -> Assumption:
    gains = problem.known.gains
    if gains is None:
        return NUMBERS_ALONE
    inside = gains.contains(_each_omega(problem))
    return Assumption("omega is in its interval", "" if inside else "omega outside its interval")


def _add_limits(draft: Draft, problem: Problem, controller: DirectMrac, simulation: Simulation, bound: float) -> None:
    """Add the limits. The frozen law moves only along q = omega (k_hat - k)'z, with q' = -omega (phi'Gamma phi + gamma_r r^2) b'P
    e."""
    gain, omega, model = Gain(controller.gamma), _omega(problem), model_bounds(problem)
    share = math.sqrt(feedforward_gain(controller) / gain.largest) * model.r
    oscillator = Oscillator(problem.known, simulation.solver, frozen_laws.input_poles(problem))
    if not problem.plant.is_linear:
        reach = np.array(state_bounds(problem)) + bound
        g = omega * gain.largest * (largest_square(problem.plant.regressor, -reach, reach) + share**2)
        if math.isfinite(g):
            frequency = math.sqrt(oscillator.bPb * g)
            draft.estimate({"adaptation_frequency": frequency, "step_max": oscillator.largest_step(g)}, FROZEN_LAW)
        return

    def limits(x: float, falling: float = 0.0) -> dict[str, Any]:
        offset = math.sqrt(omega) * math.hypot(x, share) if falling == 0 else math.sqrt(omega) * (x + share)
        return frozen_laws.of_lyapunov_law(
            problem, controller.gamma, simulation, offset, math.sqrt(omega) * falling, oscillator=oscillator
        )

    falling = bound * math.sqrt(laws.least_gain(controller.gamma))
    draft.estimate(limits(model.x_m_euclidean, falling), FROZEN_LAW, BOTH_GAINS)
    if is_needed(*frozen_laws.KEYS_AT_MODEL.values()):
        at_model = limits(largest_along_the_command(problem, simulation))
        draft.estimate({name: at_model[key] for key, name in frozen_laws.KEYS_AT_MODEL.items()}, FROZEN_LAW, BOTH_GAINS)


def column(problem: Problem, controller: DirectMrac, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells. A disturbance voids the statements on convergence, though not the bound."""
    bound = certificate.entry("error_bound")
    rests_on = _rests_on(problem, controller.bind(problem.known).gains, None if bound is None else bound.value)
    cells = lyapunov_cells(problem, certificate, rests_on, "sqrt(V(0)/lambda_min(P)) = ")
    return "direct MRAC, feedback and feedforward adapted", cells | {"estimates": statement("estimates", ESTIMATES, *rests_on)}
