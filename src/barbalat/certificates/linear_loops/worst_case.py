"""Margins of a linear loop over the known set: its extreme points, seeded points inside, and a search around the worst.

Thousands of points are screened on one grid of frequencies; the extreme points, the case's theta and the worst points of each
round are computed exactly, and the smallest of these margins is kept. A local minimum between the points may be lower: the result
is an estimate, not a guarantee.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from barbalat.linear.margins import margins
from barbalat.linear.systems import StateSpace, sensitivity, series, states_response
from barbalat.problem.known_set import KnownSet
from barbalat.problem.plant import Plant
from barbalat.validate import Array, InputError

POINTS_INSIDE, POINTS_AROUND, ROUNDS, MOST_EXTREMES = 1000, 200, 4, 1024
"""Seeded points inside the set, around the worst of each margin in each round (a quarter as wide), and extreme points at most."""
EXACT_VERTICES, EXACT_POINTS = 64, 20
"""Numbers of extreme points, and of the worst screened points for each margin, that are computed exactly."""
MARGIN_NAMES = ("delay", "phase", "gain_up", "gain_down")
SEARCH_SENTENCE = (
    "the set's {extremes} extreme points, {inside} seeded points inside, then {rounds} rounds of {around} around the worst, "
    "all screened; the {exactly} worst of each round and the case's theta exactly: the least found, not a guarantee"
)


@dataclass(frozen=True, eq=False)
class LoopsOverTheta:
    """A linear loop for every theta: the controller's loop around (A_m + b theta', b), broken at the plant's input.

    plant   the plant whose theta is replaced; its input dynamics are added to the loop here
    around  the controller's loop around a plant; (1 - theta'W_b) L and the closed loop's matrix must be affine in theta, as they
            are for every fixed linear controller, and for one whose gains contain theta once
    lag     lag of the sensor, in series with everything that is fed back
    """

    plant: Plant
    around: Callable[[Plant], StateSpace]
    lag: StateSpace | None = None

    @property
    def delay(self) -> float:
        """The delay at the plant's input [s], which is not in the loop."""
        return float(self.plant.paths[0].delay)

    def loop(self, theta: Array) -> StateSpace:
        """The loop for a theta, broken at the plant's input."""
        loop, dynamics = self.around(replace(self.plant, theta=theta)), self.plant.paths[0].dynamics
        loop = loop if dynamics is None else series(dynamics.realise(), loop)
        return loop if self.lag is None else series(loop, self.lag)

    def responses(self, w: Array) -> Callable[[Array], tuple[Array, Array]]:
        """A function from thetas (M, n) to N and D, (M, K), with L(j w) = N/D: D = 1 - h, h = theta'W_b, and N = (1 - h) L.

        Both are affine in theta: they are interpolated from the origin and the unit vectors.
        """
        units = np.eye(self.plant.n)
        W_b = states_response(self.plant.A_m, self.plant.b, w).T
        origin = self.loop(0 * units[0]).response(w)
        slopes = np.array([(1 - h) * self.loop(unit).response(w) - origin for h, unit in zip(W_b, units, strict=True)])
        return lambda thetas: (origin + _combined(thetas, slopes), 1 - _combined(thetas, W_b))

    def largest_real_parts(self, thetas: Array) -> Array:
        """Return the largest real parts of the closed loop's eigenvalues, (M,)."""
        origin = sensitivity(self.loop(np.zeros(self.plant.n))).A
        slopes = np.array([sensitivity(self.loop(unit)).A - origin for unit in np.eye(self.plant.n)])
        return np.asarray(np.linalg.eigvals(origin + np.tensordot(thetas, slopes, 1)).real.max(axis=1))

    def frequencies(self, thetas: Array) -> Array:
        """Frequencies from far below to far above every pole and every crossover that the set allows, denser near lightly damped
        modes.

        A loop that is stable with the delay d has its crossovers below 2 pi/d: some of the delay's periods are resolved finely.
        """
        loop = self.loop(np.zeros(self.plant.n))
        poles = np.concatenate([np.linalg.eigvals(loop.A), np.linalg.eigvals(sensitivity(loop).A)])
        sizes = np.abs(poles)
        crossover = float(np.abs(thetas).sum(axis=1).max() * np.abs(self.plant.b).max())
        slowest = sizes[sizes > 1e-9 * sizes.max()].min()
        wide = np.geomspace(slowest / 100, 100 * max(sizes.max(), crossover), 500)
        offsets = np.sinh(np.linspace(-5, 5, 41))
        peaks = [p.imag + abs(p.real) * offsets for p in poles if p.imag > 0]
        turns = [np.arange(1, 129) * np.pi / 16 / self.delay] if self.delay > 0 else []
        w = np.concatenate([[1e-6 * slowest], wide, *peaks, *turns])  # the first stands for zero frequency
        return np.unique(w[w > 0])


def _combined(thetas: Array, rows: Array) -> Array:
    """thetas (M, n) times rows (n, K), as sums: BLAS would start threads for it, which wait for each other on a busy machine."""
    return sum((theta[:, None] * row for theta, row in zip(thetas.T, rows, strict=True)), np.zeros(1))


@dataclass(frozen=True, eq=False)
class WorstCase:
    """The smallest margins found over the set, each with its theta, which the input's gain follows where it varies too.

    least        by the margin's name in ``Margins``; gain_down is the largest one. Infinite if nothing destabilises
    unstable_at  a theta of the set at which the loop is unstable from the start; ``None`` if none was found
    """

    least: dict[str, tuple[float, Array]]
    unstable_at: Array | None
    searched: str


def worst_case(family: LoopsOverTheta, known_set: KnownSet) -> WorstCase:
    """Search the set for the smallest margins in addition to the plant's delay, and for the largest gain reduction margin."""
    rng = np.random.default_rng(0)
    extremes = known_set.extreme_points(rng, MOST_EXTREMES)
    center = np.mean(known_set.extent, axis=0)
    own = np.reshape([family.plant.theta] if known_set.contains(family.plant.theta) else [], (-1, family.plant.n))
    points = np.concatenate([extremes, points_inside(known_set, rng, center, 1.0, POINTS_INSIDE), own])
    searched = SEARCH_SENTENCE.format(
        extremes=len(extremes), inside=POINTS_INSIDE, rounds=ROUNDS, around=POINTS_AROUND, exactly=EXACT_POINTS
    )
    search = _WorstCaseSearch(family, family.frequencies(points))
    try:
        search.look(np.concatenate([extremes[:EXACT_VERTICES], own]))
        search.screen(points)
        for k in range(1, ROUNDS + 1):
            centers = np.unique([theta for _, theta in search.least.values()], axis=0)
            search.screen(np.concatenate([points_inside(known_set, rng, theta, 4.0**-k, POINTS_AROUND) for theta in centers]))
    except _Unstable as found:
        return WorstCase({}, found.theta, searched)
    return WorstCase(search.least, None, searched)


class _Unstable(Exception):
    """A loop of the family is not stable."""

    def __init__(self, theta: Array) -> None:
        super().__init__(f"unstable at theta = {theta}")
        self.theta = theta


class _WorstCaseSearch:
    """The smallest margins so far, all of them exact."""

    def __init__(self, family: LoopsOverTheta, w: Array) -> None:
        self.family, self.w = family, w
        self.least: dict[str, tuple[float, Array]] = {}
        self._responses = family.responses(w)
        self._seen: set[bytes] = set()

    def screen(self, points: Array) -> None:
        """Screen the points, and compute the worst of them for each margin exactly."""
        real_parts = self.family.largest_real_parts(points)
        if real_parts.max() >= 0:
            raise _Unstable(points[int(real_parts.argmax())])
        N, D = self._responses(points)
        screened = screen(N * np.exp(-1j * self.w * self.family.delay), D, self.w, self.family.delay)
        for values in screened.values():
            worst = np.argsort(values)[:EXACT_POINTS]
            self.look(points[worst[np.isfinite(values[worst])]])

    def look(self, points: Array) -> None:
        """Include the exact margins at the points."""
        for theta in points:
            if theta.tobytes() in self._seen:
                continue
            self._seen.add(theta.tobytes())
            try:
                found = margins(self.family.loop(theta), self.family.delay)
            except InputError as error:
                raise _Unstable(theta) from error
            for name in MARGIN_NAMES:
                value = float(getattr(found, name))
                if name not in self.least or (
                    value > self.least[name][0] if name == "gain_down" else value < self.least[name][0]
                ):
                    self.least[name] = (value, theta)


def points_inside(known_set: KnownSet, rng: np.random.Generator, around: Array, share: float, count: int) -> Array:
    """Points of the set in a box around a point, ``share`` of the set's extent wide; points outside are moved to the set."""
    lower, upper = known_set.extent
    return known_set.brought_in(around + share * (upper - lower) * rng.uniform(-0.5, 0.5, (count, known_set.size)))


def screen(N: Array, D: Array, w: Array, delay: float = 0.0) -> dict[str, Array]:
    """Each (M,): a quantity that is smallest where the margin is worst, from responses (M, K) over w (K,), with the delay in N.

    By the names of ``Margins``; 1 - gain_down stands for gain_down, so that small values are bad for all four. "delay" is the
    tolerated delay in addition to the present one.
    """
    count = len(N)
    at, N_at, D_at, rows = _crossings(np.abs(N) - np.abs(D), N, D, w)
    lag = np.angle(-N_at * D_at.conj()) % (2 * np.pi)
    borne = (lag + at * delay) % (2 * np.pi) / at
    at, N_at, D_at, crossed = _crossings(N.imag * D.real - N.real * D.imag, N, D, w)
    real = (N_at * D_at.conj()).real
    start = (N[:, 0] * D[:, 0].conj()).real  # zero frequency, nearly
    flat = np.abs((N[:, 0] * D[:, 0].conj()).imag) < 1e-2 * np.abs(start)
    real, crossed = np.concatenate([real, start[flat]]), np.concatenate([crossed, np.flatnonzero(flat)])
    size = np.concatenate([np.abs(D_at) ** 2, np.abs(D[flat, 0]) ** 2])
    negative = real < 0
    factors, crossed = -size[negative] / real[negative], crossed[negative]
    up = factors > 1
    return {
        "delay": _least(count, rows, borne),
        "phase": _least(count, rows, np.minimum(lag, 2 * np.pi - lag)),
        "gain_up": _least(count, crossed[up], factors[up]),
        "gain_down": np.minimum(1.0, _least(count, crossed[~up], 1 - factors[~up])),
    }


def _crossings(values: Array, N: Array, D: Array, w: Array) -> tuple[Array, Array, Array, Array]:
    """Where values (M, K) change their sign along w: frequencies, N and D there, and the rows; each (crossings,)."""
    rows, k = np.nonzero(values[:, :-1] * values[:, 1:] < 0)
    left, right = values[rows, k], values[rows, k + 1]
    t = left / (left - right)
    between = [X[rows, k] + t * (X[rows, k + 1] - X[rows, k]) for X in (N, D)]
    return w[k] * (w[k + 1] / w[k]) ** t, *between, rows


def _least(count: int, rows: Array, values: Array) -> Array:
    """(count,) the smallest value of each row; infinite where it has none."""
    found = np.full(count, np.inf)
    np.minimum.at(found, rows, values)
    return found
