"""Margins of a linear loop over the known set: at its extreme points, at seeded points inside, and by a search around the worst
points.

The search screens thousands of points on one grid of frequencies. It computes the extreme points, the theta of the case and the
worst points of each round exactly, and keeps the smallest of these margins. A local minimum between the points may be lower, so
the result is an estimate, not a guarantee.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from barbalat.linear.margins import margins
from barbalat.linear.systems import StateSpace, sensitivity, series, states_response
from barbalat.problem.known_set import EstimateSet, KnownSet, ParameterBox
from barbalat.problem.plant import Plant
from barbalat.validate import Array, InputError

POINTS_INSIDE, POINTS_AROUND, ROUNDS, MOST_EXTREMES = 1000, 200, 4, 1024
"""Numbers of seeded points inside the set, of seeded points around the worst point of each margin in a round, and of rounds; the
largest number of extreme points. In each round the points lie in a box a quarter as wide as in the round before."""
EXACT_VERTICES, EXACT_POINTS = 64, 20
"""Numbers of extreme points, and of the worst screened points for each margin, that are computed exactly."""
SCREENED_AT_ONCE = 32
"""Points whose responses are computed together: few enough that they stay in the cache."""
MARGIN_NAMES = ("delay", "phase", "gain_up", "gain_down")
SEARCH_SENTENCE = (
    "the smallest found, not a guarantee. The search screens the set's {extremes} extreme points, {inside} seeded points inside "
    "and {rounds} rounds of {around} points around the worst; it computes the {exactly} worst of each round and the case's "
    "theta exactly"
)


@dataclass(frozen=True, eq=False)
class LoopsOverTheta:
    """A linear loop for every theta: the controller's loop around (A_m + b theta', b), broken at the plant's input.

    plant   the plant whose theta is replaced; its input dynamics are added to the loop here
    gains   the interval of the input gain, if it varies too; a point is then theta followed by the gain
    around  the controller's loop around a plant. (1 - theta'W_b) L and the closed loop's matrix must be affine in theta, as for
            every fixed linear controller and for controllers whose gains are affine in theta
    lag     lag of the sensor, in series with everything that is fed back
    """

    plant: Plant
    around: Callable[[Plant], StateSpace]
    lag: StateSpace | None = None
    gains: ParameterBox | None = None

    @property
    def delay(self) -> float:
        """The delay at the plant's input [s], which is not in the loop."""
        return float(self.plant.paths[0].delay)

    @property
    def own(self) -> Array:
        """The point of the plant."""
        path = self.plant.paths[0]
        return self.plant.theta if self.gains is None else np.append(self.plant.theta, path.gain)

    def loop(self, point: Array) -> StateSpace:
        """The loop for a point, broken at the plant's input."""
        theta, factors = self._apart(point[None])
        loop = self._with_theta(theta[0])
        return StateSpace(loop.A, loop.B, factors[0, 0] * loop.C, factors[0, 0] * loop.D)

    def _apart(self, points: Array) -> tuple[Array, Array]:
        """The thetas (M, n) of points, and the factors of the loop (M, 1): the input gains divided by the gain of the plant."""
        if self.gains is None:
            return points, np.ones((len(points), 1))
        return points[:, :-1], points[:, -1:] / self.plant.paths[0].gain

    def _with_theta(self, theta: Array) -> StateSpace:
        loop, dynamics = self.around(replace(self.plant, theta=theta)), self.plant.paths[0].dynamics
        loop = loop if dynamics is None else series(dynamics.realise(), loop)
        return loop if self.lag is None else series(loop, self.lag)

    def responses(self, w: Array) -> Callable[[Array], tuple[Array, Array]]:
        """A function from points (M, p) to N and D, (M, K), with L(j w) = N/D: D = 1 - h, h = theta'W_b, and N = (1 - h) L.

        Both are affine in theta, so they are interpolated from the origin and the unit vectors. The input gain multiplies N.
        """
        units = np.eye(self.plant.n)
        W_b = states_response(self.plant.A_m, self.plant.b, w).T
        origin = self._with_theta(0 * units[0]).response(w)
        slopes = np.array([(1 - h) * self._with_theta(unit).response(w) - origin for h, unit in zip(W_b, units, strict=True)])

        def at(points: Array) -> tuple[Array, Array]:
            thetas, factors = self._apart(points)
            return factors * (origin + _combined(thetas, slopes)), 1 - _combined(thetas, W_b)

        return at

    def largest_real_parts(self, points: Array) -> Array:
        """Return the largest real parts of the closed loop's eigenvalues, (M,).

        The matrix of the closed loop is that of the open loop plus the feedback times the input gain; both are affine in theta.
        """
        thetas, factors = self._apart(points)
        loops = [self._with_theta(theta) for theta in (np.zeros(self.plant.n), *np.eye(self.plant.n))]
        closed = _interpolated(thetas, [sensitivity(loop).A for loop in loops])
        if self.gains is not None:
            opened = _interpolated(thetas, [loop.A for loop in loops])
            closed = opened + factors[:, :, None] * (closed - opened)
        return np.asarray(np.linalg.eigvals(closed).real.max(axis=1))

    def frequencies(self, points: Array) -> Array:
        """Frequencies from far below to far above every pole and every crossover that the set allows, denser near lightly damped
        modes.

        A loop that is stable with the delay d has its crossovers below 2 pi/d: so the first few periods 2 pi/d are resolved
        finely.
        """
        thetas, ends = self._apart(points)[0], [None] if self.gains is None else np.ravel(self.gains.extent)
        loops = [self.loop(np.zeros(self.plant.n) if one is None else np.append(np.zeros(self.plant.n), one)) for one in ends]
        poles = np.concatenate([np.linalg.eigvals(A) for A in (loops[0].A, *(sensitivity(loop).A for loop in loops))])
        sizes = np.abs(poles)
        crossover = float(np.abs(thetas).sum(axis=1).max() * np.abs(self.plant.b).max())
        slowest = sizes[sizes > 1e-9 * sizes.max()].min()
        wide = np.geomspace(slowest / 100, 100 * max(sizes.max(), crossover), 500)
        offsets = np.sinh(np.linspace(-5, 5, 41))
        peaks = [p.imag + abs(p.real) * offsets for p in poles if p.imag > 0]
        turns = [np.arange(1, 129) * np.pi / 16 / self.delay] if self.delay > 0 else []
        w = np.concatenate([[1e-6 * slowest], wide, *peaks, *turns])  # the first frequency represents zero frequency
        return np.unique(w[w > 0])


def _interpolated(thetas: Array, matrices: list[Array]) -> Array:
    """The coefficients of an affine function of theta, from its values (M, N, N) at the origin and at the unit vectors."""
    origin, *others = matrices
    return np.asarray(origin + np.tensordot(thetas, np.array([one - origin for one in others]), 1))


def _combined(thetas: Array, rows: Array) -> Array:
    """thetas (M, n) times rows (n, K), computed as sums, because BLAS would use threads, which wait for each other on a busy
    machine."""
    return sum((theta[:, None] * row for theta, row in zip(thetas.T, rows, strict=True)), np.zeros(1))


@dataclass(frozen=True, eq=False)
class WorstCase:
    """The smallest margins found over the set, each with its theta, followed by the input gain if that varies too.

    least        the smallest value of each margin (for gain_down the largest), keyed by the names of ``Margins``. Infinite if
                 nothing destabilises the loop
    unstable_at  a theta of the set at which the loop is unstable from the start; ``None`` if none was found
    """

    least: dict[str, tuple[float, Array]]
    unstable_at: Array | None
    searched: str


def worst_case(family: LoopsOverTheta, theta_set: KnownSet) -> WorstCase:
    """Search the set, including the input gain if the family varies it, for the smallest margins in addition to the plant's
    delay, and for the largest gain reduction margin."""
    rng, known_set = np.random.default_rng(0), theta_set if family.gains is None else theta_set.with_gains(family.gains)
    extremes = known_set.extreme_points(rng, MOST_EXTREMES)
    center = np.mean(known_set.extent, axis=0)
    own = np.reshape([family.own] if known_set.contains(family.own) else [], (-1, len(family.own)))
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
        delayed = np.exp(-1j * self.w * self.family.delay)
        parts = []
        for first in range(0, len(points), SCREENED_AT_ONCE):
            N, D = self._responses(points[first : first + SCREENED_AT_ONCE])
            parts.append(screen(N * delayed, D, self.w, self.family.delay))
        for values in (np.concatenate([part[name] for part in parts]) for name in parts[0]):
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


def points_inside(known_set: EstimateSet, rng: np.random.Generator, around: Array, share: float, count: int) -> Array:
    """Points of the set in a box around a point, whose width is ``share`` of the extent of the set; points outside are moved to
    the set."""
    lower, upper = known_set.extent
    return known_set.brought_in(around + share * (upper - lower) * rng.uniform(-0.5, 0.5, (count, len(lower))))


def screen(N: Array, D: Array, w: Array, delay: float = 0.0) -> dict[str, Array]:
    """Quantities, each (M,), that are smallest where the margin is worst, from responses (M, K) over w (K,), with the delay in N.

    They have the names of ``Margins``; 1 - gain_down replaces gain_down, so that small values are bad for all four. "delay" is
    the tolerated delay in addition to the existing delay.
    """
    count = len(N)
    at, N_at, D_at, rows = _crossings(np.abs(N) - np.abs(D), N, D, w)
    lag = np.angle(-N_at * D_at.conj()) % (2 * np.pi)
    tolerated = (lag + at * delay) % (2 * np.pi) / at
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
        "delay": _least(count, rows, tolerated),
        "phase": _least(count, rows, np.minimum(lag, 2 * np.pi - lag)),
        "gain_up": _least(count, crossed[up], factors[up]),
        "gain_down": np.minimum(1.0, _least(count, crossed[~up], 1 - factors[~up])),
    }


def _crossings(values: Array, N: Array, D: Array, w: Array) -> tuple[Array, Array, Array, Array]:
    """Where values (M, K) change sign along w: the frequencies, N and D at these frequencies, and the rows; each (crossings,)."""
    rows, k = np.nonzero(values[:, :-1] * values[:, 1:] < 0)
    left, right = values[rows, k], values[rows, k + 1]
    t = left / (left - right)
    between = [X[rows, k] + t * (X[rows, k + 1] - X[rows, k]) for X in (N, D)]
    return w[k] * (w[k + 1] / w[k]) ** t, *between, rows


def _least(count: int, rows: Array, values: Array) -> Array:
    """(count,) the smallest value of each row; infinite for an empty row."""
    found = np.full(count, np.inf)
    np.minimum.at(found, rows, values)
    return found
