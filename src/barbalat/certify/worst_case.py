"""Margins of a linear loop over the known set: its extreme points, seeded points inside, and a search around the worst.

Thousands of points are screened on one grid of frequencies, the worst is then computed exactly. What is found is the least
that was seen: a local minimum between the points may be lower, so it is an estimate and no guarantee.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from barbalat.certify.loops import series
from barbalat.certify.margins import Margins, margins, sensitivity
from barbalat.known_set import KnownSet, ParameterBox
from barbalat.linear import StateSpace, states_response
from barbalat.plant import Plant
from barbalat.validate import Array

INSIDE, AROUND, ROUNDS, EXTREMES = 1000, 200, 4, 1024
"""Seeded points inside the set, around the worst in each round (each a quarter as wide), and extreme points at most."""
SEARCHED = (
    "the set's {extremes} extreme points, {inside} seeded points inside, then {rounds} rounds of {around} around the worst: "
    "the least found, no guarantee"
)


@dataclass(frozen=True, eq=False)
class Family:
    """A linear loop for every theta: around (A_m + b theta', b), from the plant's input.

    plant   whose theta is replaced; its input dynamics are put into the loop here
    around  the controller's loop around a plant; (1 - theta'W_b) L and the closed loop's matrix must be affine in theta, which
            they are for every linear controller around the plant, and for one that contains theta in its gains once
    """

    plant: Plant
    around: Callable[[Plant], StateSpace]

    def loop(self, theta: Array) -> StateSpace:
        """Broken at the plant's input."""
        loop, dynamics = self.around(replace(self.plant, theta=theta)), self.plant.paths[0].dynamics
        return loop if dynamics is None else series(dynamics.realise(), loop)

    def responses(self, w: Array) -> Callable[[Array], Array]:
        """From thetas (M, n) to L(j w), (M, K), for w (K,): (1 - h) L, h = theta'W_b, from the origin and the unit vectors."""
        units = np.eye(self.plant.n)
        W_b = states_response(self.plant.A_m, self.plant.b, w).T
        origin = self.loop(0 * units[0]).response(w)
        slopes = np.array([(1 - h) * self.loop(unit).response(w) - origin for h, unit in zip(W_b, units, strict=True)])

        def at(thetas: Array) -> Array:
            with np.errstate(divide="ignore", invalid="ignore"):  # a pole on the axis: no crossing is seen there
                return np.asarray((origin + thetas @ slopes) / (1 - thetas @ W_b))

        return at

    def largest_real_parts(self, thetas: Array) -> Array:
        """Of the closed loop's eigenvalues, (M,)."""
        origin = sensitivity(self.loop(np.zeros(self.plant.n))).A
        slopes = np.array([sensitivity(self.loop(unit)).A - origin for unit in np.eye(self.plant.n)])
        return np.asarray(np.linalg.eigvals(origin + np.tensordot(thetas, slopes, 1)).real.max(axis=1))

    def frequencies(self, thetas: Array) -> Array:
        """From far below to far above every pole and every crossover that the set allows, denser at faint damping."""
        loop = self.loop(np.zeros(self.plant.n))
        poles = np.concatenate([np.linalg.eigvals(loop.A), np.linalg.eigvals(sensitivity(loop).A)])
        sizes = np.abs(poles)
        crossover = float(np.abs(thetas).sum(axis=1).max() * np.abs(self.plant.b).max())
        wide = np.geomspace(sizes[sizes > 1e-9 * sizes.max()].min() / 100, 100 * max(sizes.max(), crossover), 500)
        offsets = np.sinh(np.linspace(-5, 5, 41))
        peaks = [p.imag + abs(p.real) * offsets for p in poles if p.imag > 0]
        w = np.concatenate([wide, *peaks])
        return np.unique(w[w > 0])


@dataclass(frozen=True, eq=False)
class WorstCase:
    """The least margins that were found over the set, each with its theta.

    least        by the margin's name in ``Margins``; gain_down is the largest one. Infinite where nothing destabilises
    unstable_at  a theta of the set at which the loop is unstable already; ``None`` if none was met
    """

    least: dict[str, tuple[float, Array]]
    unstable_at: Array | None
    searched: str


def worst_case(family: Family, known_set: KnownSet, seed: int = 0) -> WorstCase:
    """Search the set for the least delay, phase and gain margins and the greatest gain reduction margin."""
    rng = np.random.default_rng(seed)
    extremes = extreme_points(known_set, rng)
    center = np.mean(known_set.extent, axis=0)
    own = [family.plant.theta] if known_set.contains(family.plant.theta) else []
    points = np.concatenate([extremes, _inside(known_set, rng, center, 1.0, INSIDE), *np.reshape(own, (-1, 1, family.plant.n))])
    real_parts = family.largest_real_parts(points)
    searched = SEARCHED.format(extremes=len(extremes), inside=INSIDE, rounds=ROUNDS, around=AROUND)
    if real_parts.max() >= 0:
        return WorstCase({}, points[int(real_parts.argmax())], searched)
    w = family.frequencies(points)
    responses = family.responses(w)
    seen, least = screen(responses(points), w), {}
    for name, values in seen.items():
        best, lowest = points[int(values.argmin())], float(values.min())
        for k in range(1, ROUNDS + 1):
            near = _inside(known_set, rng, best, 4.0**-k, AROUND)
            found = screen(responses(near), w)[name]
            if found.min() < lowest:
                best, lowest = near[int(found.argmin())], float(found.min())
        exact: Margins = margins(family.loop(best))
        least[name] = (float(getattr(exact, name)), best)
    return WorstCase(least, None, searched)


def screen(L: Array, w: Array) -> dict[str, Array]:
    """Each (M,): what is smallest where the margin is worst, from responses (M, K) by interpolation between frequencies.

    1 - gain_down stands for gain_down: all four are then to be made small.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        t, at = _crossings(np.log(np.abs(L)))
        at_unity = L[:, :-1] + t * (L[:, 1:] - L[:, :-1])
        lag = np.angle(-at_unity) % (2 * np.pi)
        frequency = w[:-1] * (w[1:] / w[:-1]) ** t
        t, on_axis = _crossings(L.imag)
        real = L.real[:, :-1] + t * (L.real[:, 1:] - L.real[:, :-1])
        factor = np.where(on_axis & (real < 0), -1 / real, np.nan)
        edges = np.where(L.real[:, [0, -1]] < 0, -1 / L.real[:, [0, -1]], np.nan)  # zero and infinite frequency, nearly
        flat = np.abs(L.imag[:, [0, -1]]) < 1e-2 * np.abs(L.real[:, [0, -1]])
        factors = np.hstack([factor, np.where(flat, edges, np.nan)])

    def smallest(values: Array, where: Array) -> Array:
        return np.asarray(np.where(where, values, np.inf).min(axis=1))

    return {
        "delay": smallest(lag / frequency, at),
        "phase": smallest(np.minimum(lag, 2 * np.pi - lag), at),
        "gain_up": smallest(factors, factors > 1),
        "gain_down": np.minimum(1.0, smallest(1 - factors, factors < 1)),
    }


def _crossings(values: Array) -> tuple[Array, Array]:
    """Where along the last axis the sign changes, (M, K - 1): the fraction of the interval, and whether it does."""
    left, right = values[:, :-1], values[:, 1:]
    changes = (left * right < 0) & np.isfinite(left) & np.isfinite(right)
    return np.where(changes, left / np.where(changes, left - right, 1.0), 0.0), changes


def extreme_points(known_set: KnownSet, rng: np.random.Generator) -> Array:
    """A box's vertices, or as many of them drawn at random; a ball's ends along the axes and as many points of its surface."""
    n = known_set.size
    if isinstance(known_set, ParameterBox):
        if 2**n <= EXTREMES:
            signs = np.array(list(itertools.product((0.0, 1.0), repeat=n)))
        else:
            signs = rng.integers(0, 2, (EXTREMES, n)).astype(float)
        return np.asarray(known_set.lower + signs * (known_set.upper - known_set.lower))
    directions = rng.standard_normal((EXTREMES - 2 * n, n))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.asarray(known_set.center + known_set.radius * np.concatenate([np.eye(n), -np.eye(n), directions]))


def _inside(known_set: KnownSet, rng: np.random.Generator, around: Array, share: float, count: int) -> Array:
    """Points of the set in a box around a point, ``share`` of the set's extent wide; what falls outside is brought back."""
    lower, upper = known_set.extent
    points = around + share * (upper - lower) * rng.uniform(-0.5, 0.5, (count, known_set.size))
    if isinstance(known_set, ParameterBox):
        return np.clip(points, lower, upper)
    away = points - known_set.center
    return np.asarray(known_set.center + away * np.minimum(1, known_set.radius / np.linalg.norm(away, axis=1, keepdims=True)))
