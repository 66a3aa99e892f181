"""Proves polynomials nonnegative as sums of squares, which are found in floating point and verified exactly.

p = m'G m with monomials m and a positive semidefinite G. A candidate G is found by alternating between the affine set of all G
with m'G m = p and the cone. It is then moved exactly onto the set and factored in rational arithmetic, so that the proof does not
rely on the search.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from flint import fmpq, fmpq_mat

from barbalat.certificates.lyapunov.rational import as_float, exact_number
from barbalat.validate import Array

Powers = tuple[int, ...]
Terms = Mapping[Powers, fmpq]
"""A polynomial: its coefficients by the powers of the variables."""

MOST_MONOMIALS = 120
"""Largest number of monomials in m; with more, no G is sought."""
INSIDE = (0.1, 1e-2, 1e-3, 1e-5)
"""Distances from the boundary of the cone at which G is sought, scaled so that its diagonal is near one; for a polynomial whose
minimum is close to zero, only small distances are possible."""
ROUNDS = 250


class Squares(NamedTuple):
    """The proof that a polynomial is q'G q with an exact positive semidefinite G.

    q contains the monomials of y_i = x_i + the sum of beside[i][j] x_j; without an entry, y_i = x_i.
    """

    monomials: list[Powers]
    G: list[list[fmpq]]
    beside: dict[int, dict[int, fmpq]]


def is_sum_of_squares(terms: Terms) -> bool:
    """Whether the polynomial was proven to be a sum of squares; False means only that no proof was found."""
    return sum_of_squares(terms) is not None


def sum_of_squares(terms: Terms) -> Squares | None:
    """The proof that the polynomial is a sum of squares; None means only that no proof was found."""
    kept, beside = _without_constant_directions({powers: factor for powers, factor in terms.items() if factor != 0})
    used = _used(kept)
    poly = {tuple(powers[i] for i in used): factor for powers, factor in kept.items()}
    if not poly:
        return Squares([], [], {})
    monomials = _pruned(_half(list(poly)), poly)
    if not monomials or len(monomials) > MOST_MONOMIALS:
        return None
    pairs = _pairs(monomials)
    G = _gram_matrix(poly, monomials, pairs) if poly.keys() <= pairs.keys() else None
    if G is None:
        return None
    places = range(len(next(iter(terms))))
    whole = [tuple(dict(zip(used, one, strict=True)).get(i, 0) for i in places) for one in monomials]
    return Squares(whole, G, beside)


def _used(poly: Terms) -> list[int]:
    return [i for i in range(len(next(iter(poly), ()))) if any(powers[i] for powers in poly)]


def _without_constant_directions(poly: Terms) -> tuple[Terms, dict[int, dict[int, fmpq]]]:
    """The polynomial with one variable set to zero for each direction along which it is constant, and ``beside`` of Squares.

    Along such a direction every G is singular, and a search that ends close to the cone does not find a G exactly in it.
    """
    used = _used(poly)
    slopes: dict[Powers, list[fmpq]] = {}
    for powers, factor in poly.items():
        for column, i in enumerate(used):
            if powers[i]:
                lower = tuple(power - (place == i) for place, power in enumerate(powers))
                slopes.setdefault(lower, [fmpq(0)] * len(used))[column] += factor * powers[i]
    if not slopes:
        return poly, {}
    reduced, rank = fmpq_mat(list(slopes.values())).rref()
    leading = [next(j for j in range(len(used)) if reduced[i, j] != 0) for i in range(rank)]
    dropped = [j for j in range(len(used)) if j not in leading]
    beside = {used[lead]: {used[j]: reduced[i, j] for j in dropped if reduced[i, j] != 0} for i, lead in enumerate(leading)}
    return {powers: factor for powers, factor in poly.items() if not any(powers[used[j]] for j in dropped)}, beside


def _half(support: Sequence[Powers]) -> list[Powers]:
    """Monomials whose squares may be in the Newton polytope because they are in all half-spaces that contain it."""
    points = np.array(support, dtype=float)
    most = points.max(axis=0) / 2
    degrees = points.sum(axis=1)
    directions = np.vstack([np.random.default_rng(0).normal(size=(400, points.shape[1])), np.eye(points.shape[1])])
    limits = (points @ directions.T).max(axis=0) + 1e-9
    found = [one for one in _up_to(most, int(degrees.max()) // 2) if 2 * sum(one) >= degrees.min()]
    if not found:
        return []
    twice = 2.0 * np.array(found)
    return [one for one, inside in zip(found, (twice @ directions.T <= limits).all(axis=1), strict=True) if inside]


def _up_to(most: Array, degree: int) -> list[Powers]:
    """All powers with at most these exponents of each variable and at most this total degree."""
    found: list[Powers] = [()]
    for limit in most.astype(int):
        found = [(*one, power) for one in found for power in range(min(limit, degree - sum(one)) + 1)]
    return found


def _pruned(monomials: list[Powers], poly: Terms) -> list[Powers]:
    """Remove monomials whose square neither occurs in a term nor equals another product, because their row of G is zero."""
    while True:
        sums = Counter(_times(a, b) for i, a in enumerate(monomials) for b in monomials[i + 1 :])
        kept = [one for one in monomials if (square := _times(one, one)) in poly or sums[square]]
        if len(kept) == len(monomials) or len(kept) > MOST_MONOMIALS:
            return kept
        monomials = kept


def _times(a: Powers, b: Powers) -> Powers:
    return tuple(i + j for i, j in zip(a, b, strict=True))


Pairs = dict[Powers, list[tuple[int, int]]]
"""For each product of two monomials, the entries of G on or above its diagonal that contribute to it."""


def _pairs(monomials: list[Powers]) -> Pairs:
    found: Pairs = defaultdict(list)
    for i, a in enumerate(monomials):
        for j in range(i, len(monomials)):
            found[_times(a, monomials[j])].append((i, j))
    return found


def _gram_matrix(poly: Terms, monomials: list[Powers], pairs: Pairs) -> list[list[fmpq]] | None:
    found = _moved_onto(poly, [[fmpq(0)] * len(monomials) for _ in monomials], pairs)
    if is_positive_semidefinite(found):
        return found
    if all(len(places) == 1 for places in pairs.values()):
        return None  # there is only one G
    scale = _scale(poly, monomials)
    for inside in INSIDE:
        G = _between(poly, scale, pairs, inside)
        exact = [[exact_number(float(G[i, j])) * scale[i] * scale[j] for j in range(len(G))] for i in range(len(G))]
        found = _moved_onto(poly, exact, pairs)
        if is_positive_semidefinite(found):
            return found
    return None


def _scale(poly: Terms, monomials: list[Powers]) -> list[fmpq]:
    """Powers of two close to the roots of the coefficients of squares: scaling by them is exact, and the diagonal of G becomes
    close to one."""
    found = []
    for one in monomials:
        factor = as_float(poly.get(_times(one, one), fmpq(0)))
        found.append(exact_number(2.0 ** round(np.log2(factor) / 2)) if factor > 0 else fmpq(1))
    return found


def _between(poly: Terms, scale: list[fmpq], pairs: Pairs, inside: float) -> Array:
    """A matrix G in the affine set, found by alternating projections onto the (inward-shifted) cone and onto the set."""
    floats = np.array([as_float(one) for one in scale])
    size = len(scale)
    rows = [(np.array(places).T, as_float(poly.get(product, fmpq(0)))) for product, places in pairs.items()]
    G = np.zeros((size, size))
    for _ in range(ROUNDS):
        for (i, j), wanted in rows:
            weight = floats[i] * floats[j] * np.where(i == j, 1, 2)
            moved = (wanted - weight @ G[i, j]) / (weight @ (floats[i] * floats[j])) * floats[i] * floats[j]
            G[i, j] += moved
            G[j, i] = G[i, j]
        values, vectors = np.linalg.eigh(G)
        if values[0] >= inside / 2:
            break
        G = (vectors * np.maximum(values, inside)) @ vectors.T
    return G


def _moved_onto(poly: Terms, G: list[list[fmpq]], pairs: Pairs) -> list[list[fmpq]]:
    """The nearest matrix, up to rounding, with m'G m = p exactly: the residual is distributed over the entries."""
    moved = [row[:] for row in G]
    for product, places in pairs.items():
        have = sum((G[i][j] * (1 if i == j else 2) for i, j in places), fmpq(0))
        count = sum(1 if i == j else 2 for i, j in places)
        share = (poly.get(product, fmpq(0)) - have) / count
        for i, j in places:
            moved[i][j] = moved[j][i] = G[i][j] + share
    return moved


def is_positive_semidefinite(matrix: list[list[fmpq]]) -> bool:
    """Elimination in rational arithmetic: no pivot may be negative, and the row of a zero pivot must be zero."""
    work = [row[:] for row in matrix]
    size = len(work)
    for k in range(size):
        if work[k][k] < 0 or (work[k][k] == 0 and any(work[k][j] != 0 for j in range(k, size))):
            return False
        if work[k][k] == 0:
            continue
        for i in range(k + 1, size):
            if work[i][k] == 0:
                continue
            factor = work[i][k] / work[k][k]
            for j in range(i, size):
                work[i][j] -= factor * work[k][j]
                work[j][i] = work[i][j]
    return True


def is_positive_definite(matrix: fmpq_mat) -> bool:
    """Whether a matrix is symmetric and positive definite."""
    return bool(matrix == matrix.transpose() and is_positive_semidefinite(matrix.tolist()) and matrix.det() != 0)
