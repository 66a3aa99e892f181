"""Output-error fit of x' = A x + B u: the simulated states are fitted to the measured ones, exactly for held inputs.

With independent measurement errors this is maximum likelihood (Ljung, System Identification, 2nd ed., section 7.4): neither the
sampling interval nor noise in a regressor biases it. The initial states of segments and the size of the errors of each state are
estimated too. Segments that become longer from pass to pass lead from a rough first guess to the whole recording. For an unstable
plant, segments stay so short that an initial error grows over at most ``MOST_GROWTH`` time constants.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize
from scipy.linalg import expm

from barbalat.identify.recording import Recording
from barbalat.validate import Array, InputError

SHORTEST = 16
"""Number of samples in a segment of the first pass; segments are four times longer in each following pass."""
MOST_GROWTH = 4.0
STEPS = 40
"""Number of Gauss-Newton steps of a pass, with Levenberg's and Marquardt's damping."""
CONVERGED = 1e-4
"""Square of the step, in standard errors, at which a search ends: the step is then 0.01 standard errors."""
EXACT = 1e-10
"""Fraction of a state's range below which its residual is rounding error."""
SAME_INTERVAL = 1e-9
"""Relative difference up to which two sampling intervals share a transition matrix."""
CHUNK = 1024


@dataclass(frozen=True, eq=False)
class Fit:
    """matrix, spread (n, p): the coefficients [A B] and their standard errors, 0 for fixed ones

    simulated (N, n)  the fitted states
    loss              minus the logarithm of the likelihood, up to a constant
    freedom           number of measured values minus number of fitted values
    length            samples of a segment
    converged         whether the last pass ended at a minimum
    """

    matrix: Array
    spread: Array
    simulated: Array
    loss: float
    freedom: float
    length: int
    converged: bool


def fit(recording: Recording, start: Array, free: Array) -> Fit:
    """The coefficients [A B] (n, p), where those in ``free`` are searched from ``start``, which may be rough."""
    search = _Search(recording, start, free, None)
    matrix, length = start, SHORTEST
    while True:
        found = search.minimum(matrix, min(length, search.longest(matrix)), STEPS)
        matrix = found.matrix
        if length >= search.longest(matrix):
            return found
        length *= 4


def refit(
    recording: Recording, starts: Sequence[Array], free: Array, length: int, *, bounds: Array | None = None, steps: int = STEPS
) -> Fit:
    """Fit with segments of one length, beginning at the best of these starts, with coefficients within ``bounds`` (n, p, 2)."""
    search = _Search(recording, starts[0], free, bounds)
    if bounds is not None:
        length = min(length, search.longest(np.clip(starts[0], bounds[..., 0], bounds[..., 1])))
    return search.minimum(min(starts, key=lambda one: search.misfit(one, length)), length, steps)


def simulated(recording: Recording, matrix: Array) -> Array:
    """(N, n) states of the plant [A B] from the initial state that fits the measurements best; infinite if they overflow."""
    search, nothing, N = _Search(recording, matrix, np.zeros_like(matrix, dtype=bool), None), np.zeros(0), len(recording.times)
    at = search.at(nothing, search.size, N)
    return search.at(nothing, search.sizes(at), N).states if np.isfinite(at.states).all() else at.states


@dataclass(frozen=True, eq=False)
class _At:
    """The simulation at some coefficients: residuals and states (N, n), and the data for their derivatives."""

    theta: Array
    residual: Array
    states: Array
    chain: _Chain
    basis: Array  # (segments, rows, n), orthonormal: the directions that the initial states of segments can explain


class _Search:
    """One recording and structure; a point consists of the free coefficients, theta (P,)."""

    def __init__(self, recording: Recording, start: Array, free: Array, bounds: Array | None) -> None:
        self.y, self.w = recording.outputs, recording.inputs
        self.start, self.free = start, free
        steps = np.diff(recording.times)
        self.mean_step = float(steps.mean())
        _, first, self.which = np.unique(
            np.round(steps / (self.mean_step * SAME_INTERVAL)), return_index=True, return_inverse=True
        )
        self.steps = steps[first]
        moved, largest = np.ptp(self.y, axis=0), np.abs(self.y).max(axis=0)
        self.size = np.where(moved > 0, moved, np.where(largest > 0, largest, 1.0))
        self.floor = EXACT * self.size
        self.bounds = np.array([[-np.inf, np.inf]] * int(free.sum())) if bounds is None else bounds[free]

    def longest(self, matrix: Array) -> int:
        """The number of samples of the longest segment for these coefficients."""
        n, N = self.y.shape[1], len(self.y)
        growth = float(np.linalg.eigvals(matrix[:, :n]).real.max()) * self.mean_step
        return N if growth * N <= 1 else min(N, max(4, int(MOST_GROWTH / growth)))

    def misfit(self, matrix: Array, length: int) -> float:
        """The squared residuals, relative to the ranges of the states."""
        return _square(self.at(matrix[self.free], self.size, length).residual / self.size)

    def minimum(self, matrix: Array, length: int, steps: int) -> Fit:
        """The minimum from these coefficients with segments of this length."""
        theta = np.clip(matrix[self.free], self.bounds[:, 0], self.bounds[:, 1])
        at = self.at(theta, self.size, length)
        if not np.isfinite(at.residual).all():
            raise InputError(f"the least-squares estimate diverges within {length} samples: no plant can be fitted to them")
        sigma = self.sizes(at)
        at, damping, converged = self.at(theta, sigma, length), 1e-3, False
        for _ in range(steps):
            J = self.derivatives(at, sigma)
            r = self.weighted(at.residual, sigma, at.chain)
            size = _sizes(J)
            R = np.linalg.qr(np.column_stack([J / size, r])).R
            while damping < 1e10:
                step = self.step(R, size, at.theta, damping)
                trial = self.at(at.theta + step, sigma, length)
                if _square(trial.residual / sigma) <= _square(at.residual / sigma):
                    break
                damping *= 10
            else:
                break
            moved = float(np.sum((R[:, :-1] @ (step * size)) ** 2))
            at, sigma = trial, self.sizes(trial)
            converged = moved < CONVERGED and damping <= 1e-2
            if converged:
                break
            damping = max(damping / 10, 1e-12)
        return self.told(at, length, converged)

    def told(self, at: _At, length: int, converged: bool) -> Fit:
        """The fit at a minimum, with its standard errors."""
        N, n = self.y.shape
        fitted = len(at.theta) + n * at.chain.segments
        sigma = self.sizes(at) * math.sqrt(N / max(N - fitted / n, 1.0))
        J = self.derivatives(at, sigma)
        size = _sizes(J)
        inverse = np.linalg.pinv(np.linalg.qr(J / size).R, rcond=1e-10) / size[:, None]
        matrix, spread = self.start.copy(), np.zeros_like(self.start)
        matrix[self.free] = at.theta
        spread[self.free] = np.linalg.norm(inverse, axis=1)
        loss = N * float(np.sum(np.log(self.sizes(at))))
        return Fit(matrix, spread, at.states, loss, max(N * n - fitted, 1.0), length, converged)

    def sizes(self, at: _At) -> Array:
        """(n,) RMS of the residuals, but at least the size of rounding errors."""
        return np.sqrt(np.mean(at.residual**2, axis=0) + self.floor**2)

    def at(self, theta: Array, sigma: Array, length: int) -> _At:
        """The simulation with the initial states that fit the measurements best."""
        n, m = self.y.shape[1], self.w.shape[1]
        matrix = self.start.copy()
        matrix[self.free] = theta
        whole = np.zeros((n + m, n + m))
        whole[:n] = matrix
        with np.errstate(all="ignore"):
            step = np.asarray(expm(self.steps[:, None, None] * whole))[:, :n][self.which]
            chain = _Chain(step[:, :, :n], length)
            forced = chain.driven(np.einsum("knm,km->kn", step[:, :, n:], self.w[:-1])[:, :, None])[:, :, 0]
            if not (np.isfinite(forced).all() and np.isfinite(chain.initial).all()):
                nowhere = np.full_like(self.y, np.inf)
                return _At(theta, nowhere, nowhere, chain, np.zeros((chain.segments, 0, n)))
        basis, triangle = np.linalg.qr(self.by_segments(chain.initial / sigma[:, None], chain))
        rest = self.by_segments(((self.y - forced) / sigma)[:, :, None], chain)
        starts = np.linalg.solve(triangle, basis.transpose(0, 2, 1) @ rest)[:, :, 0]
        states = forced + np.einsum("kij,kj->ki", chain.initial, starts[chain.segment_of])
        return _At(theta, self.y - states, states, chain, basis)

    def derivatives(self, at: _At, sigma: Array) -> Array:
        """The derivatives (rows, P) of the negative weighted residuals, without the part that the initial states explain."""
        n, p = self.start.shape
        where = np.argwhere(self.free)
        matrix = self.start.copy()
        matrix[self.free] = at.theta
        double = np.zeros((len(where), 2 * p, 2 * p))  # exp([[M, E], [0, M]] h) holds the derivative of exp(M h) along E
        double[:, :n, :p] = double[:, p : p + n, p:] = matrix
        for k, (i, j) in enumerate(where):
            double[k, i, p + j] = 1.0
        D = np.asarray(expm(self.steps[:, None, None, None] * double))[:, :, :n, p:]  # (intervals, P, n, p)
        v = np.column_stack([at.states, self.w])[:-1]
        if len(self.steps) == 1:
            g = np.einsum("Pnp,kp->knP", D[0], v, optimize=True)
        else:
            parts = [slice(k, k + CHUNK) for k in range(0, len(v), CHUNK)]
            g = np.concatenate([np.einsum("kPnp,kp->knP", D[self.which[part]], v[part], optimize=True) for part in parts])
        J = self.by_segments(at.chain.driven(g) / sigma[:, None], at.chain)
        J = J - at.basis @ (at.basis.transpose(0, 2, 1) @ J)
        return J.reshape(-1, len(where))

    def weighted(self, residual: Array, sigma: Array, chain: _Chain) -> Array:
        return self.by_segments((residual / sigma)[:, :, None], chain).reshape(-1)

    @staticmethod
    def by_segments(values: Array, chain: _Chain) -> Array:
        """Reshape (N, n, c) to (segments, rows, c), with zeros after the last sample."""
        N, n, c = values.shape
        padded = np.zeros((chain.segments * chain.length, n, c))
        padded[:N] = values
        return padded.reshape(chain.segments, chain.length * n, c)

    def step(self, R: Array, size: Array, theta: Array, damping: float) -> Array:
        """The damped step within the bounds, from the triangular factor of [J / size, r]."""
        P = len(size)
        A = np.vstack([R[:, :P], math.sqrt(damping) * np.eye(P)])
        b = np.concatenate([R[:, P], np.zeros(P)])
        lower, upper = ((end - theta) * size for end in self.bounds.T)
        if np.isinf(self.bounds).all():
            return np.linalg.lstsq(A, b, rcond=None)[0] / size
        open_ = lower < upper
        step = np.zeros(P)
        step[open_] = optimize.lsq_linear(A[:, open_], b, (lower[open_], upper[open_])).x
        return np.clip(theta + step / size, *self.bounds.T) - theta


class _Chain:
    """The recursion z[k+1] = Phi[k] z[k] + g[k] over segments of samples, which all begin with z = 0.

    The recursion runs over blocks of about sqrt(N) samples at once, which are joined afterwards.
    """

    def __init__(self, Phi: Array, length: int) -> None:
        N, n = len(Phi) + 1, Phi.shape[1]
        self.N, self.block = N, min(length, math.isqrt(N - 1) + 1)
        of_segment = max(1, round(length / self.block))
        self.length = of_segment * self.block
        self.segments = -(-N // self.length)
        self.blocks = self.segments * of_segment
        self.segment_of = np.arange(N) // self.length
        self.begins = np.arange(self.blocks) % of_segment == 0
        self.Phi = self._cut(Phi)
        self.within, self.across = self._run(np.broadcast_to(np.eye(n), (self.blocks, n, n)), None)
        self.initial = self._joined(np.zeros((self.blocks, 1, n, n)), np.zeros((self.blocks, n, n)), np.eye(n))

    def driven(self, g: Array) -> Array:
        """(N, n, c) z for g (N-1, n, c)."""
        g = self._cut(g)
        forced, ends = self._run(np.zeros((self.blocks, *g.shape[2:])), g)
        return self._joined(forced, ends, np.zeros(g.shape[2:]))

    def _cut(self, steps: Array) -> Array:
        padded = np.zeros((self.blocks * self.block, *steps.shape[1:]))
        padded[: len(steps)] = steps
        return padded.reshape(self.blocks, self.block, *steps.shape[1:])

    def _run(self, z: Array, g: Array | None) -> tuple[Array, Array]:
        """z at every sample of all blocks, (blocks, block, n, c), and after the blocks."""
        found = np.empty((self.blocks, self.block, *z.shape[1:]))
        for k in range(self.block):
            found[:, k] = z
            z = self.Phi[:, k] @ z
            if g is not None:
                z = z + g[:, k]
        return found, z

    def _joined(self, forced: Array, ends: Array, start: Array) -> Array:
        """(N, n, c) from the responses of the blocks and the state that each block passes to the next block of its segment."""
        handed = np.empty((self.blocks, *start.shape))
        for i in range(self.blocks):
            handed[i] = start if self.begins[i] else self.across[i - 1] @ handed[i - 1] + ends[i - 1]
        z = forced + self.within @ handed[:, None]
        return z.reshape(-1, *start.shape)[: self.N]


def _sizes(J: Array) -> Array:
    """Norms of the columns; 1 for columns of norm 0."""
    size = np.linalg.norm(J, axis=0)
    return np.where(size > 0, size, 1.0)


def _square(values: Array) -> float:
    total = float(np.sum(values**2))
    return total if math.isfinite(total) else math.inf
