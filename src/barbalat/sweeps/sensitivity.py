"""First-order Sobol indices: the fraction of a metric's variance over the members that each varied number explains by itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec

import numpy as np

from barbalat.open_numbers.path import FieldPath
from barbalat.sweeps.chunks import Rows
from barbalat.sweeps.plan import Design, Plan
from barbalat.sweeps.spread import InBall
from barbalat.sweeps.statistics import CONFIDENCE_LEVEL
from barbalat.validate import Array, counted

MOST_DRAWS = 2**14
"""Largest number of draws of an estimate: its interval is then about 0.01 wide, and it takes 0.1 s."""
FEWEST_DRAWS = 128
"""Least number of draws: with fewer, RBD-FAST's spectrum has too few points for its ten harmonics."""
RESAMPLES = 50
"""Number of resamples of the bootstrap."""
SMALLEST_SHARE_OF_VARIANCE = 1e-20
"""A fraction below this is rounding error: the square of the rounding error of a sum of 10^6 numbers."""
FIGURES = ("max_abs_e", "rms_e", "tail_max_abs_e", "max_abs_u", "max_abs_y")
"""The evaluated metrics, without indices of components."""


@dataclass(frozen=True, kw_only=True)
class Sensitivity:
    """The sensitivity of one metric of one controller to one varied number.

    first      fraction of the variance, with its interval ``low`` to ``high``; both ends equal the fraction if it is exact for
               the grid. Estimates below 0 or above 1 are clipped
    total      the fraction including interactions of the number with others; only for Saltelli's design, otherwise None
    estimator  how the fractions were obtained
    """

    controller: str
    figure: str
    path: FieldPath
    first: float
    low: float
    high: float
    total: float | None
    estimator: str

    def as_json(self) -> dict[str, object]:
        return {**vars(self), "path": str(self.path)}


SALTELLI, RBD_FAST, FACTORIAL = (
    "Saltelli 2010 by SciPy, bootstrap",
    "RBD-FAST by SALib, bootstrap",
    "main effect on the grid, exact",
)


def sensitivities(rows: Rows, controllers: Sequence[str], plan: Plan) -> tuple[list[Sensitivity], list[str]]:
    """Sensitivities of the metrics that all members have, and sentences on the metrics and numbers without a sensitivity."""
    found: list[Sensitivity] = []
    notes: list[str] = []
    if plan.draws and plan.design is not Design.SALTELLI:
        if plan.members < FEWEST_DRAWS:
            notes.append(f"sensitivity to drawn numbers needs at least {FEWEST_DRAWS} draws, got {plan.members}")
        elif find_spec("SALib") is None:
            notes.append("sensitivity to drawn numbers needs the package SALib: pip install 'barbalat[study]'")
    if any(isinstance(one, InBall) for one in plan.draws.values()):
        notes.append(
            "entries of a ball are not independent: their fractions of a variance overlap and need not add up to the whole"
        )
    for controller in controllers:
        without: dict[int, list[str]] = {}
        for name in rows.names:
            figure = name.removeprefix(f"{controller}/")
            if name == figure or figure.split("[")[0] not in FIGURES:
                continue
            values = rows.column(name)
            if lacking := int((~np.isfinite(values)).sum()):
                without.setdefault(lacking, []).append(figure)
            elif values.min() < values.max():
                found += _of(rows, values, plan, partial(Sensitivity, controller=controller, figure=figure))
        for lacking, figures in without.items():
            which = figures[0] if len(figures) == 1 else f"{figures[0]} to {figures[-1]} ({len(figures)} figures)"
            notes.append(f"{controller}: {counted(lacking, 'member')} without {which}, whose variance is therefore unknown")
    return found, notes


def _cut(share: float) -> float:
    return min(max(float(share), 0.0), 1.0)


Made = Callable[..., Sensitivity]
"""A function of one metric of one controller and the remaining arguments."""


def _of(rows: Rows, values: Array, plan: Plan, made: Made) -> Iterator[Sensitivity]:
    values = _near_one(values)
    if plan.design is Design.SALTELLI:
        yield from _saltelli(values, plan, made)
        return
    by_point = values.reshape(*(axis.count for axis in plan.axes.values()), plan.draws_each)
    total = float(values.var())
    for i, path in enumerate(plan.axes):
        others = tuple(k for k in range(by_point.ndim) if k != i)
        share = float(by_point.mean(axis=others).var()) / total
        share = 0.0 if share < SMALLEST_SHARE_OF_VARIANCE else share
        yield made(path=path, first=share, low=share, high=share, total=None, estimator=FACTORIAL)
    if plan.members >= FEWEST_DRAWS and find_spec("SALib") is not None:
        yield from _drawn(rows, by_point, plan, total, made)


def _near_one(values: Array) -> Array:
    """The values times a power of two, which changes no bit of any fraction of a variance.

    Squares of very small or very large values would underflow or overflow, and the variance would be zero or infinite.
    """
    return np.ldexp(values, -int(np.frexp(np.abs(values).max())[1]))


def _drawn(rows: Rows, by_point: Array, plan: Plan, total: float, made: Made) -> Iterator[Sensitivity]:
    """The sensitivity of the mean over the grid to the drawn numbers; the variance of that mean is a part of the whole
    variance."""
    from SALib.analyze import rbd_fast

    mean = by_point.mean(axis=tuple(range(len(plan.axes)))) if plan.axes else by_point
    part = float(mean.var()) / total if plan.axes else 1.0
    count = min(plan.members, MOST_DRAWS)
    if mean[:count].min() == mean[:count].max():
        return
    given = np.column_stack([rows.column(str(path))[:count].copy() for path in plan.draws])
    names = [str(path) for path in plan.draws]
    problem = {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}
    found = rbd_fast.analyze(problem, given, mean[:count], num_resamples=RESAMPLES, conf_level=CONFIDENCE_LEVEL, seed=plan.seed)
    for path, first, half in zip(plan.draws, found["S1"], found["S1_conf"], strict=True):
        low, middle, high = (_cut(part * share) for share in (first - half, first, first + half))
        yield made(path=path, first=middle, low=low, high=high, total=None, estimator=RBD_FAST)


def _saltelli(values: Array, plan: Plan, made: Made) -> Iterator[Sensitivity]:
    from scipy.stats import bootstrap, sobol_indices

    n, d = plan.members, len(plan.draws)
    a, b, ab = values[:n], values[n : 2 * n], values[2 * n :].reshape(d, 1, n)
    if values[: 2 * n].min() == values[: 2 * n].max():
        return  # the estimators divide by the variance of A and B
    found = sobol_indices(func={"f_A": a[None], "f_B": b[None], "f_AB": ab}, n=n)
    first, whole = np.atleast_2d(found.first_order)[0], np.atleast_2d(found.total_order)[0]
    mean = values[: 2 * n].mean()

    def first_order(rows: Array) -> Array:
        """Saltelli's 2010 estimator, (d,), over some of the rows."""
        of_a, of_b, of_ab = a[rows] - mean, b[rows] - mean, ab[:, 0, rows] - mean
        return np.asarray((of_b * (of_ab - of_a)).mean(axis=1) / np.var([of_a, of_b]))

    generator = np.random.default_rng(plan.seed)  # SobolResult.bootstrap accepts no seed: its intervals differ from run to run
    resampled = bootstrap(
        [np.arange(n)], first_order, confidence_level=CONFIDENCE_LEVEL, n_resamples=RESAMPLES, method="BCa", rng=generator
    )
    low, high = map(np.atleast_1d, resampled.confidence_interval)
    for i, path in enumerate(plan.draws):
        interval = {"low": _cut(low[i]), "high": _cut(high[i])}
        yield made(path=path, first=_cut(first[i]), **interval, total=_cut(whole[i]), estimator=SALTELLI)
