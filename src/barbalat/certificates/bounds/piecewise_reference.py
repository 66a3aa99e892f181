"""How closely the piecewise-constant law follows its theory's reference system, on the plant (1) with phi(x) = x.

x_ref' = A_m x_ref + b (theta'x_ref + u_ref), u_ref = C(s)[k_0 r - theta'x_ref], x_ref(0) = x(0), C at rest, under the command as
it is sampled; as flown u_ref = k_0 r - theta_0'x_ref - C(s)[(theta - theta_0)'x_ref]. Loop and reference system are linear and,
under held commands, exact from sample to sample, so their difference is one linear system: what r can do to it is the sum of
its impulse response, for every bounded r.

Between samples a motion is off the straight line between its ends by at most T^2/8 times its second derivative. With v held,
x'' = e^(A tau) A (A x_k + B v_k), at most e^(|A| T) |A (A x_k + B v_k)| in every component: so for the plant, and for the
reference system.

Source of the reference system: Hovakimyan and Cao, L1 Adaptive Control Theory (2010), section 3.3, where C(s) acts in continuous
time and the bound goes to zero with T.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from barbalat.controllers.l1_piecewise import Equations, L1PiecewiseConstant, realisation, started
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.linear.sampled_norms import SampledNorms
from barbalat.linear.systems import StateSpace
from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.problem.state_feedback import Problem
from barbalat.validate import Array, InputError


class Distance(NamedTuple):
    """The largest component of |x - x_ref|."""

    at_samples: float
    between: float  # at all times


def distance(problem: Problem, controller: L1PiecewiseConstant, levels: Array) -> Distance:
    """For commands of these sizes (q,), held from sample to sample; InputError where loop or reference system is unstable."""
    equations, plant = controller.bind(problem.known), problem.plant
    T, n, q = controller.sample_time, plant.n, len(levels)
    single = StateSpace.gain(1.0) if controller.filter is None else controller.filter.realise()
    A, B = _reference(problem, equations, single)
    if not np.linalg.eigvals(A).real.max() < 0:
        raise InputError("its reference system is unstable")
    held, found = HeldSystem.of(A, B, T), realisation(equations)
    M, N = _sampled(problem, equations, T)
    a, r, b = len(M), len(A), plant.b.reshape(n, -1)
    free = np.concatenate([plant.x0, started(equations, plant.x0, np.zeros(q)), plant.x0, np.zeros(r - n)])
    # the filter's first sample is no step of it, so the first command stands in the initial state too
    first = np.array([started(equations, np.zeros(n), unit) for unit in np.eye(q)]).T
    first = np.vstack([np.zeros((n, q)), first, np.zeros((r, q))])
    whole = np.block([[M, np.zeros((a, r))], [np.zeros((r, a)), held.Phi]])
    command = np.vstack([N, held.Gamma])

    def largest(C: Array, D: Array) -> Array:
        """C z + D r| at the samples, z what stands in ``whole``.|Return the largest |C z + D r| at the samples, where z is the
        state of ``whole``.|C z + D r| at the samples, z what stands in ``whole``."""
        norms = SampledNorms(whole, C)
        driven = norms.summed(command) + norms.largest(first) + np.abs(D)
        return np.asarray(driven @ levels + norms.largest(free[:, None])[:, 0])

    at_samples = float(largest(np.hstack([np.eye(n, a), -np.eye(n, r)]), np.zeros((n, q))).max())
    of_x, of_r = found.D[:, :n], found.D[:, n:]
    slope_x = np.hstack([plant.A + b @ of_x, b @ found.C, np.zeros((n, r))])
    slope_ref = np.hstack([np.zeros((r, a)), A])
    curved = _grown(plant.A, T) @ largest(plant.A @ slope_x, plant.A @ b @ of_r)
    curved = curved + (_grown(A, T) @ largest(A @ slope_ref, A @ B))[:n]
    return Distance(at_samples, float(at_samples + T**2 / 8 * curved.max()) * OUTWARD_FACTOR)


def _grown(A: Array, T: float) -> Array:
    """e^(|A| T), at least |e^(A tau)| in every entry for 0 <= tau <= T."""
    from scipy.linalg import expm

    return np.asarray(expm(np.abs(A) * T)) * OUTWARD_FACTOR


def _sampled(problem: Problem, equations: Equations, T: float) -> tuple[Array, Array]:
    """(x, s)[k+1] = M (x, s)[k] + N r[k], with the controller's realisation s."""
    plant, found = problem.plant, realisation(equations)
    n = plant.n
    held = HeldSystem.of(plant.A, plant.b.reshape(n, -1), T)
    of_x, of_r = found.D[:, :n], found.D[:, n:]
    M = np.block([[held.Phi + held.Gamma @ of_x, held.Gamma @ found.C], [found.B[:, :n], found.A]])
    return M, np.vstack([held.Gamma @ of_r, found.B[:, n:]])


def _reference(problem: Problem, equations: Equations, C: StateSpace) -> tuple[Array, Array]:
    """(A, B) of (x_ref, the filter's state) under r."""
    plant, n, m = problem.plant, problem.plant.n, problem.plant.inputs
    b, theta = plant.b.reshape(n, m), plant.theta.reshape(n, m).T
    baseline = np.zeros((m, n)) if equations.direct is None else equations.direct.reshape(n, m).T
    left = theta - baseline
    passed = np.zeros_like(equations.k_0) if equations.direct is not None else equations.k_0
    beside = equations.k_0 - passed
    A_z, B_z, C_z = (np.kron(np.eye(m), part) for part in (C.A, C.B[:, None], C.C[None, :]))
    A = np.block([[plant.A - b @ (baseline + C.D * left), b @ C_z], [-B_z @ left, A_z]])
    return A, np.vstack([b @ (beside + C.D * passed), B_z @ passed])
