"""The certificate of MRAC with a network: bounds from its modification, in numbers if the case allows, and the column of Table 1.

No ideal weights are known, so nothing depends on how well the network approximates (see ``bounds``). No numbers are known for a
plant that the feedback of the model alone does not stabilise.

The modification bounds the weights and, on the plant (1), e.

With mu = b'P e, (m,), h = (1, tanh(z)), z = V_hat'x_bar, and |.| of a matrix the Frobenius norm, the law makes U =
|W_hat|^2/gamma + |V_hat|^2/gamma_v change by U' = 2 mu'W_hat'h - 2 w (|W_hat|^2 + |V_hat|^2), where x_bar drops out. The network
adds -2 mu'W_hat'h to (e'P e)', so with e' = A e + b (f - W_hat'h), Q = -(P A + A'P) and L = e'P e + U

    L' = -e'Q e + 2 mu'f - 2 w (|W_hat|^2 + |V_hat|^2):

whatever the network has learnt, it never increases L. With |f_j| <= F_j, lambda = lambda_min(Q) > 0, p_j = |P b_j| and s = |e|,
mu'f is at most p'F s, and L can grow only if lambda s^2 + 2 w omega^2 <= 2 mu'f, omega^2 = |W_hat|^2 + |V_hat|^2, so it
stays below the larger of its maximum there and its initial value. For w = nu |mu|_1 the weights are bounded for any motion of the
plant: for a neuron's outer weights W_i, (m,), (|W_i|^2)' = 2 gamma (c_i mu'W_i - nu |mu|_1 |W_i|^2) with c_i = h_i - h_i' z_i in
[-1, 1] is negative for |W_i| > 1/nu, since |mu| <= |mu|_1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from barbalat.certificates import theorems
from barbalat.certificates.assumptions import ACTS_CONTINUOUSLY, START_TOGETHER, bounded_command, exact_plant, measured
from barbalat.certificates.bounds.formulas import largest_square
from barbalat.certificates.bounds.model import command_bounds, require_lyapunov, state_bounds
from barbalat.certificates.cells import denied, estimate, limits_text, margins_cell, nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption, Entry
from barbalat.certificates.quantities import Form, Quantity
from barbalat.certificates.rows import up
from barbalat.certificates.schemes.unregistered import add_linearised
from barbalat.controllers.mrac_network import Equations, NetworkMrac
from barbalat.linear.conditions import smallest_eigenvalue
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.linear.l1_norms import l1_norm
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import BoundedSignal
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

ROUNDING = 1e-12
"""Tolerance as a fraction of |P| |A|, far above the rounding errors of an entry of P A + A'P."""
MOST_TRIALS = 100
GROWTH = 1.02
"""Factor from one trial bound on e to the next; MOST_TRIALS of them span the whole useful range."""


NO_BOUND = (
    "without weights known to approximate theta'phi, its proof requires A_m to dominate theta'phi, which is not the case here"
)


@dataclass(frozen=True)
class WeightBounds:
    """Bounds on every component of e, on the vector of outer weights of one neuron, and on |V_hat|. A missing bound is None, and
    ``why`` is the reason."""

    error: float | None = None
    W_hat: float | None = None
    V_hat: float | None = None
    why: str = NO_BOUND


@dataclass(frozen=True, eq=False)
class NetworkLaw:
    """The numbers that the bounds need from the modification of a law."""

    gamma: float
    gamma_v: float
    rows: int  # of W_hat, 1 + N
    start: float  # |V_hat(0)|^2/gamma_v, which is L(0) and U(0), rounded up
    sigma: float | None  # coefficient of the sigma-modification
    nu: float | None  # of the e-modification

    @classmethod
    def of(cls, equations: Equations) -> NetworkLaw:
        leakage, size = equations.leakage, math.hypot(*equations.V_0.reshape(-1).tolist())  # its square may be infinite
        return cls(
            gamma=equations.gamma,
            gamma_v=equations.gamma_v,
            rows=1 + equations.neurons,
            start=size * size / equations.gamma_v * OUTWARD_FACTOR,
            sigma=leakage.largest if leakage.per_error is None else None,
            nu=leakage.per_error,
        )

    def highest_level(self, F: Array, lowest: float, highest: float, p: Array) -> float:
        """An upper bound on L, from |f_j| <= F_j, lambda_min(Q) >= ``lowest``, lambda_max(P) <= ``highest``, |P b_j| <= p_j."""
        least, push, most = min(self.gamma, self.gamma_v), float(p @ F), float(F.max())
        farthest = 2 * push / lowest  # L decreases if |e| exceeds this
        if self.nu is not None:  # omega^2 <= (mu'f - lambda s^2/2)/(nu |mu|_1), mu'f <= most |mu|_1: convex in s, so at an end
            left = max(0.0, most - push / float(p.sum()))  # for s = farthest
            found = max(highest * farthest**2 + left / (self.nu * least), most / (self.nu * least))
        else:  # omega^2 <= (2 push s - lambda s^2)/(2 sigma)
            assert self.sigma is not None
            found = _largest(highest - lowest / (2 * self.sigma * least), push / (self.sigma * least), farthest)
        return max(self.start, found) * OUTWARD_FACTOR

    @property
    def whatever_acts(self) -> WeightBounds | None:
        """The bounds on the weights from the e-modification, which hold under any disturbance."""
        if self.nu is None:
            return None
        far = math.sqrt(self.rows) / self.nu  # U decreases if omega^2 > far |W_hat|
        level = max(self.start, _largest(1 / self.gamma - 1 / self.gamma_v, far / self.gamma_v, far))
        return WeightBounds(W_hat=OUTWARD_FACTOR / self.nu, V_hat=math.sqrt(self.gamma_v * level) * OUTWARD_FACTOR**2)


def _largest(a: float, b: float, end: float) -> float:
    """max a s^2 + b s for 0 <= s <= end, with b >= 0."""
    at = [end] if a >= 0 else [min(end, -b / (2 * a))]
    return max(0.0, *(a * s * s + b * s for s in at))


@dataclass(frozen=True, eq=False)
class ErrorBoundCase:
    """The numbers that the bound on e needs from the problem."""

    problem: Problem
    law: NetworkLaw
    x_m: Array  # (n,) bounds
    d: float

    @classmethod
    def of(cls, problem: Problem, equations: Equations) -> ErrorBoundCase:
        """Raise InputError for signals without a bound."""
        d, bound = problem.disturbance, 0.0
        if d is not None:
            if not isinstance(d, BoundedSignal):
                raise InputError("the disturbance has no known bound")
            bound = d.bound
        return cls(problem, NetworkLaw.of(equations), np.array(state_bounds(problem)), bound)

    def largest_matched(self, reach: float) -> Array:
        """An upper bound on |theta_j'phi(x) + d_j| for each input, (m,), if every |x_i| is at most the model's bound plus
        ``reach``."""
        plant, far = self.problem.plant, self.x_m + reach
        theta = plant.theta.reshape(-1, plant.inputs)
        if plant.is_linear:
            return np.asarray((far @ np.abs(theta) + self.d) * OUTWARD_FACTOR)
        square = largest_square(plant.regressor, -far, far)
        return np.asarray((np.linalg.norm(theta, axis=0) * math.sqrt(square) + self.d) * OUTWARD_FACTOR)

    @property
    def columns(self) -> Array:
        """b, (n, m)."""
        return self.problem.known.b.reshape(self.problem.known.n, -1)

    def level(self, A: Array, F: Array) -> float:
        """An upper bound on L with |f_j| <= F_j and e' = A e + b (f - W_hat'h)."""
        known = self.problem.known
        P = known.P
        require_lyapunov(known)
        lowest = smallest_eigenvalue(-(P @ A + A.T @ P)) - ROUNDING * float(np.linalg.norm(P) * np.linalg.norm(A))
        if not lowest > 0:
            raise InputError("P A + A'P is not certainly negative definite")
        highest = float(np.linalg.eigvalsh(P)[-1]) * OUTWARD_FACTOR
        return self.law.highest_level(F, lowest, highest, np.linalg.norm(P @ self.columns, axis=0) * OUTWARD_FACTOR)

    def error_of(self, level: float) -> float:
        return math.sqrt(level / smallest_eigenvalue(self.problem.known.P)) * OUTWARD_FACTOR

    def driven(self, A: Array, F: Array) -> float:
        """A bound on e that treats the outputs of the network as bounded disturbances; only the e-modification gives one."""
        bound = self.law.whatever_acts
        if bound is None or bound.W_hat is None:
            return math.inf
        n, largest = self.problem.known.n, F + self.law.rows * bound.W_hat
        norms = [l1_norm(A, b[:, None], np.eye(n), np.zeros((n, 1))).upper for b in self.columns.T]
        return float(np.dot(norms, largest)) * OUTWARD_FACTOR

    def globally(self) -> tuple[float, float | None] | None:
        """The bound on e, and the bound on L if it follows, for phi(x) = x; the true A replaces A_m."""
        A, F = self.problem.plant.A, self.largest_matched(0.0)
        found: list[tuple[float, float | None]] = []
        try:
            level = self.level(A, F)
            found.append((self.error_of(level), level))
        except InputError:
            pass
        if np.linalg.eigvals(A).real.max() < 0:
            found.append((self.driven(A, F), None))
        finite = [each for each in found if math.isfinite(each[0])]
        return min(finite, key=lambda each: each[0]) if finite else None

    def trapped(self) -> tuple[float, float | None] | None:
        """A bound E on e for any phi: as long as |e| <= E holds, |e| stays below E."""
        A, reach = self.problem.known.A_m, 0.0
        for _ in range(MOST_TRIALS):
            F = self.largest_matched(reach)
            if not np.isfinite(F).all():
                return None
            level = self.level(A, F)
            by_level, by_norm = self.error_of(level), self.driven(A, F)
            following = min(by_level, by_norm)
            if following < reach:
                return following, level if by_level <= by_norm else None
            reach = GROWTH * following
        return None


def bounds(problem: Problem, equations: Equations) -> WeightBounds:
    """All bounds that can be found on e and on the outer and inner weights."""
    always = NetworkLaw.of(equations).whatever_acts
    try:
        case = ErrorBoundCase.of(problem, equations)
        found = case.globally() if problem.plant.is_linear else case.trapped()
    except InputError as refused:  # a command or disturbance without a bound, or an A_m too close to instability
        return replace(always or WeightBounds(), why=str(refused))
    error, level = found if found is not None else (None, None)
    if always is not None:
        return replace(always, error=error)
    if level is None:
        return WeightBounds(error=error)
    W_hat, V_hat = (math.sqrt(gain * level) * OUTWARD_FACTOR for gain in (equations.gamma, equations.gamma_v))
    return WeightBounds(error, W_hat, V_hat)


def control_bound(problem: Problem, equations: Equations, W_hat: float) -> float:
    """A bound on every entry of |u|, from the bound on the outer weights of one neuron or, with the sigma-modification, from the
    bound on all outer weights together."""
    together = equations.leakage.per_error is None
    weights = math.sqrt(1 + equations.neurons) if together else 1 + equations.neurons
    return (weights * W_hat + float(command_bounds(problem).max())) * OUTWARD_FACTOR**2


OWN_QUANTITIES = {
    "W_hat_bound": Quantity("bound on every outer weight, and on the norm of a neuron's weights, at all times"),
    "V_hat_bound": Quantity("bound on the norm of all inner weights, at all times"),
    "control_bound": Quantity("bound on every entry of |u|, at all times"),
    "V_hat0": Quantity("the initial inner weights, those of the constant 1 first", form=Form.MATRIX, timeless=True),
}
NO_WEIGHTS = "with the sigma-modification the weights are bounded if e is, but no bound on e was found"
STARTS_AT_ZERO = Assumption("W_hat(0) = 0")
WHATEVER_ACTS = (STARTS_AT_ZERO, ACTS_CONTINUOUSLY)
CORNER_AT_REST = (
    "for e'P b = 0 many weights are equilibria, and the e-modification's leakage has a corner, so there is no linearisation"
)
NOT_TO_ZERO = "its modification does not guarantee convergence of the error to zero; the error stays in a set"


def certificate(problem: Problem, controller: NetworkMrac, simulation: Simulation) -> Certificate:
    """The guarantees of the modification, and the findings from the linearisations."""
    draft, equations = Draft(own=OWN_QUANTITIES), controller.bind(problem.known)
    draft.note("the network never makes L = e'P e + |W_hat|^2/gamma + |V_hat|^2/gamma_v grow; a benefit is not proven")
    found, nominal, always = bounds(problem, equations), _nominal(problem), _of_the_weights(problem, controller)
    if found.error is None:
        draft.missing("error_bound", found.why, *nominal, theorem=theorems.NETWORK)
    else:
        draft.guarantee("error_bound", found.error, *nominal)
    if found.W_hat is None:
        draft.all_missing(("W_hat_bound", "V_hat_bound", "control_bound"), NO_WEIGHTS)
    else:
        draft.guarantee("W_hat_bound", found.W_hat, *always)
        draft.guarantee("V_hat_bound", found.V_hat, *always)
        _add_control_bound(draft, problem, equations, found.W_hat, always)
    draft.advise({"V_hat0": equations.V_0.tolist()})
    if _is_e_modified(controller):
        draft.note("many weights are equilibria: the margins are for those nearest to the initial ones")
    add_linearised(draft, problem, controller, simulation, bent=CORNER_AT_REST if _is_e_modified(controller) else "")
    return draft.finish()


def grounds(problem: Problem, controller: NetworkMrac, _: Simulation) -> dict[str, Any]:
    """The numbers of the bounds from the e-modification."""
    equations = controller.bind(problem.known)
    law = NetworkLaw.of(equations)
    weights = {"neurons": equations.neurons, "V_hat0": equations.V_0.reshape(-1).tolist()}
    scheme = "network" if law.nu is not None else "network, sigma"
    return {"scheme": scheme, "gamma": law.gamma, "gamma_v": law.gamma_v, "nu": law.nu} | weights


def _of_the_weights(problem: Problem, controller: NetworkMrac) -> tuple[Assumption, ...]:
    """The assumptions of the bounds on the weights; with the e-modification, only the law."""
    return WHATEVER_ACTS if _is_e_modified(controller) else _nominal(problem)


def _is_e_modified(controller: NetworkMrac) -> bool:
    assert controller.leakage is not None  # the constructor has checked it
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
    beside = Assumption("the only disturbance is bounded and matched", ", ".join(word for word, there in acts if there))
    plant = exact_plant(problem), beside, measured(problem)
    return *plant, bounded_command(problem), START_TOGETHER, STARTS_AT_ZERO, ACTS_CONTINUOUSLY


def column(problem: Problem, controller: NetworkMrac, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    nominal, found = _nominal(problem), bounds(problem, controller.bind(problem.known))
    stability, transient = nothing("stability", found.why, *nominal), nothing("transient", found.why, *nominal)
    if found.error is not None:
        stability = statement("stability", "bounded by its modification, uniformly in time", *nominal)
        transient = statement("transient", f"|e| <= {up(found.error)} at all times", *nominal)
    estimates = nothing("estimates", NO_WEIGHTS)
    if found.W_hat is not None:
        text = f"there are no true weights; every outer weight stays within {up(found.W_hat)}"
        estimates = statement("estimates", text, *_of_the_weights(problem, controller))
    robust = nothing("modelling_error", "boundedness of x is known with a bounded matched disturbance, not for Delta_m")
    e_modified = _is_e_modified(controller)
    if e_modified:
        robust = nothing("modelling_error", "weights and u stay bounded in any case; boundedness of x is not known for Delta_m")
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
