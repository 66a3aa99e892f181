"""A bound of e = y - y_m under L1 output feedback with the piecewise-constant law, for every r and d of the case's sizes.

Plant, controller and the model under the command as it is sampled are one linear system from sample to sample: what r can do to e
at the samples is the sum of its impulse response. d acts all the time: in a sample what it does to a row c of that is at most
|d| integral_0^T |c e^(A s) B| ds, and within a part of the sample e^(A s) B is off its value at the part's start s_j by at most
|e^(A s_j)| (e^(|A| T/P) - I) |B|. Between samples, as in ``piecewise_reference``, a motion under a held input is off the straight
line by at most T^2/8 times its second derivative.

The model itself follows r between the samples too. With r of slope at most L between jumps of at most J that are D apart,

    |W_m[r - r_held]| <= ||W_m||_1 L T + J T (||s W_m||_1 + ||W_m||_1/(D - T)):

each jump is missed for at most T, and a sum of |h| at points D - T apart is at most its total variation, ||s W_m||_1, and
integral |h|/(D - T).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from barbalat.certificates.entry import NotApplicable
from barbalat.controllers.output.l1_piecewise import Equations
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.sampled_norms import SampledNorms
from barbalat.linear.systems import StateSpace
from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.problem.output_feedback import OutputProblem
from barbalat.protocols import BoundedSignal, BreakingSignal, Signal, SlopedSignal
from barbalat.signals.piecewise import rounding_of
from barbalat.validate import Array

PARTS = 16
"""e| at all times: against the model under the command as it is sampled, and against the model under r.|Bounds of |e| at all
times, against the model driven by the sampled command and against the model driven by r.a sample, in which d is bounded: finer
ones change no digit that is shown where the plant is slow in a sample."""


class ErrorBound(NamedTuple):
    """C z + D r| at the samples.|Return the largest |C z + D r| at the samples.|e| at all times: against the model under the
    command as it is sampled, and against the model under r."""

    held: float
    error: float | NotApplicable


class _Loop(NamedTuple):
    """z[k+1] = M z[k] + N r[k], u = K z + L r, with z = (plant, predictor, filter, model); from ``first`` times the first r."""

    M: Array
    N: Array
    K: Array
    L: Array
    first: Array
    plant: StateSpace
    model: StateSpace


def error_bound(problem: OutputProblem, equations: Equations, t_end: float) -> ErrorBound | NotApplicable:
    """InputError where the loop is unstable from sample to sample, or forgets too slowly for a bound."""
    r, d = problem.reference, problem.disturbance
    if not isinstance(r, BoundedSignal) or not (d is None or isinstance(d, BoundedSignal)):
        return NotApplicable("r or d has no known bound")
    held = _held(_loop(problem, equations), equations.sample_time, r.bound, 0.0 if d is None else d.bound)
    missed = _missed(problem.known.W_m.realise(), r, equations.sample_time, t_end)
    if isinstance(missed, NotApplicable):
        return ErrorBound(held, missed)
    return ErrorBound(held, (held + missed) * OUTWARD_FACTOR)


def _held(loop: _Loop, T: float, r: float, d: float) -> float:
    plant, model, size = loop.plant, loop.model, len(loop.M)
    p, m = plant.order, model.order
    starts = [HeldSystem.of(plant.A, plant.B, j * T / PARTS).Phi for j in range(PARTS)]
    off = (_grown(plant.A, T / PARTS) - np.eye(p)) @ np.abs(plant.B)
    reached = np.hstack([np.column_stack([start @ plant.B, start]) for start in starts])  # in a sample, before its end
    weights = T / PARTS * np.tile(np.append(1.0, off), PARTS)

    def largest(C: Array, D: Array) -> Array:
        """Of |C z + D r| at the samples."""
        norms = SampledNorms(loop.M, C)
        driven = norms.summed(loop.N[:, None])[:, 0] + norms.largest(loop.first[:, None])[:, 0] + np.abs(D)
        if d == 0:
            return np.asarray(driven * r)
        of_d = norms.summed(np.vstack([reached, np.zeros((size - p, reached.shape[1]))])) @ weights
        return np.asarray(driven * r + of_d * d)

    difference = np.concatenate([plant.C, np.zeros(size - p - m), -model.C])
    at_samples = largest(difference[None], np.zeros(1))[0]
    bends = plant.A @ (np.hstack([plant.A, np.zeros((p, size - p))]) + np.outer(plant.B, loop.K))
    curved = np.abs(plant.C) @ _grown(plant.A, T) @ largest(bends, plant.A @ plant.B * loop.L)
    of_model = model.A @ np.hstack([np.zeros((m, size - m)), model.A])
    curved += np.abs(model.C) @ _grown(model.A, T) @ largest(of_model, model.A @ model.B)
    within = np.abs(plant.C @ reached) @ weights * d  # at a sample's end it is in the bound at the samples, and not in the line
    return float(at_samples + 2 * within + T**2 / 8 * curved) * OUTWARD_FACTOR


def _loop(problem: OutputProblem, equations: Equations) -> _Loop:
    plant, model, T = problem.plant.dynamics.system, problem.known.W_m.realise(), equations.sample_time
    f, G, c = equations.filter, equations.G, equations.c
    p, n, order = plant.order, len(c), len(f.A)
    size = p + n + order + n
    of_y = np.concatenate([plant.C, -c, np.zeros(order + n)])  # y - y_hat
    sigma = np.outer(G, of_y)
    wanted = np.diag(np.append(-1.0, np.ones(n - 1))) @ sigma  # what passes the filter, beside r in its first entry
    passed = np.hstack([np.zeros((order, p + n)), np.eye(order), np.zeros((order, n))]) + f.B @ wanted
    K, L = (f.C @ passed + f.D @ wanted)[0], float((f.C @ f.B + f.D)[0, 0])
    held, of_model = HeldSystem.of(plant.A, plant.B, T), HeldSystem.of(model.A, model.B, T)
    Phi, Gamma = equations.model.Phi, equations.model.Gamma
    M, N = np.zeros((size, size)), np.zeros(size)
    M[:p, :p] = held.Phi
    M[:p] += np.outer(held.Gamma, K)
    M[p : p + n, p : p + n] = Phi
    M[p : p + n] += Gamma @ sigma + np.outer(Gamma[:, 0], K)
    M[p + n : -n] = f.A @ passed + f.B @ wanted
    M[-n:, -n:] = of_model.Phi
    N[:p], N[p : p + n], N[-n:] = held.Gamma * L, Gamma[:, 0] * L, of_model.Gamma
    N[p + n : -n] = f.A @ f.B[:, 0] + f.B[:, 0]
    first = np.zeros(size)
    first[p + n : -n] = -f.B[:, 0]  # the filter's first sample is no step of it
    return _Loop(M, N, K, L, first, plant, model)


def _missed(model: StateSpace, r: Signal, T: float, t_end: float) -> float | NotApplicable:
    """|W_m[r - r_held]| up to t_end."""
    if not isinstance(r, SlopedSignal) or not isinstance(r, BoundedSignal):
        return NotApplicable("how far r goes within a sample is not known")
    whole = _norm(model, model.C, 0.0)
    largest, apart = _jumps(r, T, t_end)
    rate = _norm(model, model.C @ model.A, float(model.C @ model.B))
    jumping = largest * T * (rate + whole / (apart - T)) if apart > T else np.inf
    found = whole * r.slope * T + (jumping if largest > 0 else 0.0)
    return float(min(found, 2 * r.bound * whole)) * OUTWARD_FACTOR


def _jumps(r: Signal, T: float, t_end: float) -> tuple[float, float]:
    """The largest jump between samples, and how far such jumps are apart at least."""
    at = r.breaks(0.0, t_end) if isinstance(r, BreakingSignal) else np.zeros(0)
    at = at[np.abs(at - T * np.round(at / T)) > rounding_of(at)]
    sizes = np.abs(r(at) - r.before(at))
    at = at[sizes > 0]
    return float(sizes.max(initial=0.0)), float(np.diff(at).min(initial=np.inf))


def _norm(model: StateSpace, C: Array, D: float) -> float:
    return l1_norm(model.A, model.B[:, None], C[None], np.array([[D]])).upper


def _grown(A: Array, T: float) -> Array:
    """e^(|A| T)."""
    from scipy.linalg import expm

    return np.asarray(expm(np.abs(A) * T)) * OUTWARD_FACTOR
