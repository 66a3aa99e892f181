"""Guaranteed bounds on the command and on the reference model, by L1 norms and a Lyapunov function."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from barbalat.linear.conditions import exact_matrix, lyapunov_holds
from barbalat.linear.driven_response import driven_response
from barbalat.linear.enclosure import OUTWARD_FACTOR, float_above
from barbalat.linear.l1_norms import l1_norm
from barbalat.problem.state_feedback import Known, Problem
from barbalat.protocols import BoundedSignal
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError


@dataclass(frozen=True)
class ModelBounds:
    """Guaranteed bounds on the command and the reference model: sup |r|, sup max_i |x_m,i|, sup |x_m|_2."""

    r: float
    x_m: float
    x_m_euclidean: float


def model_bounds(problem: Problem) -> ModelBounds:
    """Bounds computed from the bound on the signal and from L1 norms, not from samples. Raises InputError for a signal without a
    bound."""
    r = problem.reference
    if not isinstance(r, BoundedSignal):
        raise InputError(f"a certificate needs a reference with a known bound, but {r!r} has none")
    each = state_bounds(problem)
    return ModelBounds(r.bound, max(each), math.hypot(*each) * OUTWARD_FACTOR)


def motion_along_the_command(problem: Problem, simulation: Simulation) -> tuple[Array, Array]:
    """Instants (K,) and x_m (K, n) at these instants under the command of the case: the exact response to the command
    interpolated linearly between the instants."""
    known, (A_m, B, _) = problem.known, problem.model.matrices
    return driven_response(A_m, B, np.eye(known.n), known.x0, problem.commands, simulation.t_end, simulation.steps)


@lru_cache(maxsize=16)  # shared by the controllers of one case
def largest_along_the_command(problem: Problem, simulation: Simulation) -> float:
    """The largest |x_m|_2 in the run under the command of the case. This is the largest value at sampled instants, not a
    bound."""
    return float(np.linalg.norm(motion_along_the_command(problem, simulation)[1], axis=1).max())


def command_bounds(problem: Problem) -> Array:
    """(m,) bounds on sup |(k_0 r)_j|; raises InputError for a command without a bound."""
    pushed = np.zeros(problem.known.inputs)
    for command, column in zip(problem.commands, np.reshape(problem.known.k_0, (len(pushed), -1)).T, strict=True):
        if not isinstance(command, BoundedSignal):
            raise InputError(f"a certificate needs a reference with a known bound, but {command!r} has none")
        pushed += np.abs(column) * command.bound
    return pushed


def state_bounds(problem: Problem) -> list[float]:
    """Guaranteed bounds on sup |x_m,i|, i = 1 ... n, for any inputs and commands: the sum of the individual bounds."""
    known, n, pushed = problem.known, problem.known.n, command_bounds(problem)
    columns = known.b.reshape(n, -1).T
    if known.enters is not None:  # the commands also enter directly, each through a column
        pushed = np.array([command.bound for command in problem.commands if isinstance(command, BoundedSignal)])
        columns = problem.model.matrices[1].T

    def forced(i: int) -> float:
        norms = [l1_norm(known.A_m, b[:, None], np.eye(n)[i : i + 1], np.zeros((1, 1))).upper for b in columns]
        return float(np.dot(pushed, norms))

    return [(forced(i) + free) * OUTWARD_FACTOR for i, free in enumerate(_free_response_bounds(known))]


def _free_response_bounds(known: Known) -> list[float]:
    """sup over t of |e_i'e^{A_m t} x0|, which is at most sqrt(x0'P x0) sqrt((P^-1)_ii) because V = x'Px decreases."""
    if not known.x0.any():
        return [0.0] * known.n
    require_lyapunov(known)
    P, x0 = exact_matrix(known.P), exact_matrix(known.x0[:, None])
    energy, inverse = (x0.transpose() * P * x0)[0, 0], P.inv()
    return [float_above((energy * inverse[i, i]).sqrt()) for i in range(known.n)]


def require_lyapunov(known: Known) -> None:
    """Raise InputError unless P is provably a Lyapunov matrix of A_m."""
    if not lyapunov_holds(known.P, known.A_m):
        raise InputError("P A_m + A_m'P could not be verified to be negative definite: A_m is too close to losing stability")
