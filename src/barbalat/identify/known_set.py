"""Set membership: all rows of coefficients that explain the data within error bounds, enclosed by means of linear programmes.

Over a window of samples the plant x' = A x + B u with held inputs gives, row by row,

    x_i(end) - x_i(start) = sum_j A_ij (integral of x_j) + sum_l B_il (integral of u_l).

Both sides are known from the measurements with bounded errors. |y - x| <= nu gives the left side within 2 nu_i. The trapezoidal
sum of y_j is the integral of x_j within E_j = sum over the steps of h nu_j + L_j h^2 / 4, where the second term follows from
|x_j'| <= L_j. A row a explains a window if

    |dy - Q a| <= 2 nu_i + sum_j E_j |a_j|,

which is exact for errors anywhere in their box. That set is not convex, but it is a polyhedron in each orthant of the
coefficients whose regressors have an error, where linear programmes give its extreme values. With more than ``MOST_ORTHANTS``
such coefficients, |a_j| is replaced by its chord over an interval that contains a_j, which gives a convex set that contains the
exact set.

Every bound follows by weak duality and is rounded outward. The results of the solver serve only as multipliers, which may be
inexact.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from barbalat.validate import Array, InputError

MOST_ORTHANTS = 6
"""Number of coefficients of noisy regressors up to which the set is searched orthant by orthant, in at most 2^6 orthants."""
EPS = float(np.finfo(float).eps)
SLACK = 1e-9
"""Fraction of a window's error bound by which programmes are widened, so that they remain feasible despite rounding."""
CHORD_PASSES = 6
BEYOND_ALL = 1e9
"""Emptiness is proven for rows up to this many times the ratio of the changes to the regressors; a larger row does not describe a
plant."""
TOLERANCE = 1e-6
"""Tolerance of the programmes, in units of the windows' error bounds; the tolerance of the solver is a tenth of it."""
FACTOR_PASSES = 20


@dataclass(frozen=True, eq=False)
class Windows:
    """The bounds that windows of the data give for one row: |left - Q a| <= left_error + Q_error |a|.

    left (K,), Q (K, p), left_error (K,), Q_error (K, p), where all errors include rounding
    """

    left: Array
    Q: Array
    left_error: Array
    Q_error: Array

    @property
    def noisy(self) -> Array:
        """(p,) which coefficients multiply a regressor with an error above rounding."""
        return (self.Q_error > 1e-9 * np.abs(self.Q).max(axis=0, initial=0.0)).any(axis=0)

    def explained_by(self, a: Array) -> Array:
        """(K,) whether a row explains each window."""
        return np.abs(self.left - self.Q @ a) <= self.left_error + self.Q_error @ np.abs(a)

    def factor(self, a: Array) -> float:
        """The factor by which the error bounds would have to be multiplied for a row to explain all windows."""
        missed = np.abs(self.left - self.Q @ a)
        with np.errstate(divide="ignore"):
            ratio = np.divide(missed, self.left_error + self.Q_error @ np.abs(a), where=missed > 0, out=np.zeros_like(missed))
        return float(ratio.max())


@dataclass(frozen=True, eq=False)
class Enclosure:
    """Bounds, each (p,), on every row that explains the windows; infinite if unbounded.

    exact    whether the orthants were searched, in which case only the correlation of the coefficients is lost
    empty    whether it is proven that no row explains the windows (no row up to ``BEYOND_ALL`` if the errors leave directions of
             the set unbounded)
    """

    lower: Array
    upper: Array
    exact: bool
    empty: bool = False


def enclose(windows: Windows, within: Array | None = None) -> Enclosure:
    """Bound every coefficient over all rows that explain the windows.

    within  (p, 2), prior bounds, infinite if there are none
    """
    p = windows.Q.shape[1]
    prior = _everything(p) if within is None else np.array(within, dtype=float)
    silent = ~(windows.Q.any(axis=0) | windows.Q_error.any(axis=0))  # no window bounds these coefficients
    scaled, scale = _by_columns(Windows(windows.left, windows.Q[:, ~silent], windows.left_error, windows.Q_error[:, ~silent]))
    bounds = prior[~silent] * scale[:, None]
    exact = int(scaled.noisy.sum()) <= MOST_ORTHANTS
    found = _by_orthants(scaled, bounds) if exact else _by_chords(scaled, bounds)
    if found is None:
        return Enclosure(np.full(p, np.inf), np.full(p, -np.inf), exact, empty=True)
    box = prior.copy()
    box[~silent] = found / scale[:, None]
    return Enclosure(box[:, 0], box[:, 1], exact)


def least_factor(windows: Windows, within: Array | None = None) -> float:
    """The smallest common factor of the error bounds, as far as found, with which some row explains the windows.

    Linear programmes minimise the largest ratio of a misfit to its bound over the rows of each orthant (Dinkelbach 1967,
    Management Science 13(7)). With more than ``MOST_ORTHANTS`` noisy coefficients, only the orthant of the least-squares row is
    searched.
    """
    scaled, scale = _by_columns(windows)
    bounds = _everything(len(scale)) if within is None else within * scale[:, None]
    best = np.clip(np.linalg.lstsq(scaled.Q, scaled.left, rcond=None)[0], bounds[:, 0], bounds[:, 1])
    noisy = np.flatnonzero(scaled.noisy)
    of_best = tuple(np.where(best[noisy] < 0, -1.0, 1.0))
    others = product((-1.0, 1.0), repeat=len(noisy)) if len(noisy) <= MOST_ORTHANTS else ()
    for signs in (of_best, *(other for other in others if other != of_best)):
        best = _least_factor_of(scaled, _orthant(bounds, noisy, signs), best)
    return scaled.factor(best)


def _least_factor_of(windows: Windows, bounds: Array, best: Array) -> Array:
    """The row of an orthant with the smallest factor, or ``best`` if no row is better."""
    if (bounds[:, 0] > bounds[:, 1]).any():
        return best
    signs = np.where(bounds[:, 0] >= 0, 1.0, np.where(bounds[:, 1] <= 0, -1.0, 0.0))
    for _ in range(FACTOR_PASSES):
        factor = windows.factor(best)
        unit = windows.left_error + windows.Q_error @ np.abs(best)
        E = factor * windows.Q_error * signs
        G = np.vstack([-windows.Q - E, windows.Q - E]) / np.tile(unit, 2)[:, None]
        g = np.concatenate([factor * windows.left_error - windows.left, factor * windows.left_error + windows.left])
        reach = [(low if np.isfinite(low) else None, high if np.isfinite(high) else None) for low, high in bounds]
        solved = linprog(
            np.append(np.zeros(len(bounds)), 1.0), A_ub=np.column_stack([G, -np.ones(len(G))]), b_ub=g / np.tile(unit, 2),
            bounds=[*reach, (-factor, None)], method="highs",
        )  # fmt: skip
        if solved.x is None:
            return best
        found = np.clip(solved.x[:-1], bounds[:, 0], bounds[:, 1])
        if windows.factor(found) >= factor * (1 - 1e-4):
            return best
        best = found
    return best


def _everything(p: int) -> Array:
    return np.column_stack([np.full(p, -np.inf), np.full(p, np.inf)])


def _by_columns(windows: Windows) -> tuple[Windows, Array]:
    """The windows for coefficients that are multiplied by powers of two (without rounding errors) to give all regressors size
    1."""
    scale = 2.0 ** np.round(np.log2(np.maximum(np.abs(windows.Q).max(axis=0), 1e-300)))
    return Windows(windows.left, windows.Q / scale, windows.left_error, windows.Q_error / scale), scale


def _orthant(bounds: Array, noisy: Array, signs: tuple[float, ...]) -> Array:
    """The part of the bounds in which the noisy coefficients have these signs."""
    part = bounds.copy()
    for j, sign in zip(noisy, signs, strict=True):
        part[j] = (max(part[j, 0], 0.0), part[j, 1]) if sign > 0 else (part[j, 0], min(part[j, 1], 0.0))
    return part


def _by_orthants(windows: Windows, prior: Array) -> Array | None:
    """The hull over the orthants of the noisy coefficients; None if all are proven empty."""
    noisy = np.flatnonzero(windows.noisy)
    parts = []
    for signs in product((-1.0, 1.0), repeat=len(noisy)):
        bounds = _orthant(prior, noisy, signs)
        if (bounds[:, 0] > bounds[:, 1]).any():
            continue
        slope, offset = np.zeros(len(prior)), np.zeros(len(prior))
        slope[noisy] = signs
        parts.append(_polyhedron(windows, bounds, slope, offset))
    if all(part.empty for part in parts):
        return None
    boxes = np.array([part.box for part in parts if part.box is not None])
    return np.column_stack([boxes[:, :, 0].min(axis=0), boxes[:, :, 1].max(axis=0)])


def _by_chords(windows: Windows, prior: Array) -> Array | None:
    """The convex outer set, from a first box given by the data or by ``within``."""
    bounds = prior.copy()
    if not np.isfinite(bounds[windows.noisy]).all():
        first = _first_box(windows)
        bounds = np.column_stack([np.maximum(bounds[:, 0], -first), np.minimum(bounds[:, 1], first)])
    for _ in range(CHORD_PASSES):
        lower, upper = bounds.T
        width = upper - lower
        finite = np.isfinite(width) & (width > 0) & windows.noisy
        slope, offset = np.zeros(len(bounds)), np.zeros(len(bounds))
        slope[finite] = (np.abs(upper[finite]) - np.abs(lower[finite])) / width[finite]
        ends = np.maximum(
            np.abs(lower[finite]) - slope[finite] * lower[finite], np.abs(upper[finite]) - slope[finite] * upper[finite]
        )
        offset[finite] = ends + 4 * EPS * (np.abs(lower[finite]) + np.abs(upper[finite]))
        point = windows.noisy & (width == 0)
        offset[point] = np.abs(upper[point])
        found = _polyhedron(windows, bounds, slope, offset)
        if found.empty or found.box is None:
            return None
        bounds = np.column_stack([np.maximum(bounds[:, 0], found.box[:, 0]), np.minimum(bounds[:, 1], found.box[:, 1])])
    return bounds


def _first_box(windows: Windows) -> Array:
    """|a| <= box for every row that explains the windows, from a left inverse M: |a| <= |M left| + |M| (errors + Q_error |a|)."""
    M = np.linalg.pinv(windows.Q)
    p = windows.Q.shape[1]
    rest = np.abs(np.eye(p) - M @ windows.Q) + 8 * EPS * len(M.T) * (np.abs(M) @ np.abs(windows.Q))  # M is not exactly an inverse
    beta = (np.abs(M @ windows.left) + np.abs(M) @ (windows.left_error + 8 * EPS * len(M.T) * np.abs(windows.left))) * (1 + 1e-9)
    box = _self_bounded(beta, rest + np.abs(M) @ windows.Q_error * (1 + 1e-9))
    if box is None:
        raise InputError(
            f"more than {MOST_ORTHANTS} noisy regressors whose errors are too large to bound the plant from data alone; "
            "give bounds on its coefficients by within"
        )
    return box


def _self_bounded(beta: Array, R: Array) -> Array | None:
    """A box with |a| <= box for every a with |a| <= beta + R |a|; None if it cannot be proven that the spectral radius of R is
    below 1."""
    with np.errstate(all="ignore"):
        box = np.linalg.solve(np.eye(len(beta)) - R, beta + 1e-300) * (1 + 1e-9) if np.isfinite(R).all() else beta
    if not np.isfinite(box).all() or not (box > 0).all():
        return None
    # box > beta + R box proves that R's spectral radius is below 1, and with it that no larger |a| is possible
    return box if (box * (1 - 1e-12) >= (beta + R @ box) * (1 + 1e-12)).all() else None


class _Part(NamedTuple):
    """Bounds (p, 2) of a polyhedron (None if it is empty), and whether it is empty up to ``BEYOND_ALL``."""

    box: Array | None
    empty: bool


def _polyhedron(windows: Windows, bounds: Array, slope: Array, offset: Array) -> _Part:
    """Bounds of {a within bounds: |left - Q a| <= left_error + Q_error (slope a + offset)}.

    For coefficients without noise, Q_error is only rounding error, which is covered by the far larger slack.
    """
    noisy = windows.noisy
    E = np.where(noisy, windows.Q_error, 0.0)
    right = windows.left_error + E @ offset
    G = np.vstack([-windows.Q - E * slope, windows.Q - E * slope])
    g = np.concatenate([right - windows.left, right + windows.left])
    g = g + SLACK * np.concatenate([right, right]) + 16 * EPS * (np.abs(np.concatenate([windows.left] * 2)) + np.abs(g))
    G_error = 8 * EPS * np.vstack([np.abs(windows.Q) + E] * 2) + np.vstack([np.where(noisy, 0.0, windows.Q_error)] * 2)
    unit = 2.0 ** -np.round(np.log2(np.maximum(windows.left_error + E @ (np.abs(slope) + offset), 1e-300)))  # no rounding
    unit = np.concatenate([unit, unit])
    G, g, G_error = _with_bounds(G * unit[:, None], g * unit, G_error * unit[:, None], bounds)
    p = len(bounds)
    free = [(None, None)] * p
    most_violated = np.column_stack([G, -np.ones(len(G))])
    least = linprog(np.append(np.zeros(p), 1.0), A_ub=most_violated, b_ub=g, bounds=[*free, (-1.0, None)], method="highs")
    needed = max(0.0, float(least.x[-1])) if least.x is not None else 0.0
    # more than needed, so that the solver does not consider a set of a single point to be empty
    programmes = _dual_bounds(G, g + (2 * needed + TOLERANCE if needed else 0.0), G_error)
    size = max(np.abs(windows.left).max(), windows.left_error.max(), np.abs(bounds[np.isfinite(bounds)]).max(initial=0.0))
    box = np.full(p, BEYOND_ALL * size) if programmes is None else programmes[0]
    empty = needed > 0 and _proven_empty(G, g, G_error, -np.asarray(least.ineqlin.marginals), box)
    if programmes is None:
        return _Part(np.where(np.isfinite(bounds), bounds, [-np.inf, np.inf]), empty)
    found = programmes[1]
    inside = np.column_stack([np.maximum(found[:, 0], bounds[:, 0]), np.minimum(found[:, 1], bounds[:, 1])])
    return _Part(None if empty else inside, empty)


def _with_bounds(G: Array, g: Array, G_error: Array, bounds: Array) -> tuple[Array, Array, Array]:
    """The bounds of the coefficients as rows, which are exact."""
    unit = np.eye(len(bounds))
    low, high = np.isfinite(bounds).T
    rows = np.vstack([-unit[low], unit[high]])
    return (
        np.vstack([G, rows]),
        np.concatenate([g, -bounds[low, 0], bounds[high, 1]]),
        np.vstack([G_error, np.zeros_like(rows)]),
    )


def _dual_bounds(G: Array, g: Array, G_error: Array) -> tuple[Array, Array] | None:
    """Bounds of {a: G a <= g} from multipliers, which may be inexact: a box (p,) of |a|, and (p, 2); None if not bounded.

    For y >= 0, c'a <= y'g + (c - G'y)'a. With c = e_j and -e_j for all j, |a| <= beta + R |a| with R of the size of rounding.
    """
    p = G.shape[1]
    values, rests = np.zeros((p, 2)), np.zeros((p, 2, p))
    for j, (k, sign) in product(range(p), enumerate((-1.0, 1.0))):
        c = np.zeros(p)
        c[j] = sign
        solved = linprog(-c, A_ub=G, b_ub=g, bounds=[(None, None)] * p, method="highs")
        if solved.status != 0:
            return None
        y = np.maximum(-np.asarray(solved.ineqlin.marginals), 0.0)
        values[j, k], rests[j, k] = _weak_dual(c, y, G, g, G_error)
    beta = np.maximum(values.max(axis=1), 0.0)
    box = _self_bounded(beta + 1e-12 * beta.max(initial=1e-300), rests.max(axis=1))
    if box is None:
        return None
    reach = values + rests @ box * (1 + 1e-12)
    reach = reach + 8 * EPS * np.abs(reach)
    return box, np.column_stack([-reach[:, 0], reach[:, 1]])


def _weak_dual(c: Array, y: Array, G: Array, g: Array, G_error: Array) -> tuple[float, Array]:
    """Upper bounds on y'g and, by entries, on |c - G'y|."""
    used = y > 0
    y, G, g, G_error = y[used], G[used], g[used], G_error[used]
    gamma = (len(y) + 4) * EPS
    value = float(y @ g + gamma * (y @ np.abs(g)))
    rest = np.abs(c - y @ G) + gamma * (np.abs(c) + y @ np.abs(G)) + (y @ G_error) * (1 + gamma)
    return value, rest


def _proven_empty(G: Array, g: Array, G_error: Array, y: Array, box: Array) -> bool:
    """Whether 0 <= y'(g - G a) is impossible for every a in the box, by y'g + |G'y| box < 0."""
    value, rest = _weak_dual(np.zeros(len(box)), np.maximum(y, 0.0), G, g, G_error)
    return value + float(rest @ box) * (1 + 1e-12) < 0.0
