"""The panel of a run's estimates: with the true values, and the known set where it is near enough to be drawn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from barbalat.loop.true_values import estimate_set
from barbalat.pictures.panels import Level, Panel, Series, around, span_of, width_of
from barbalat.problem.known_set import UNREACHED_BOUND, EstimateSet
from barbalat.problem.state_feedback import Problem
from barbalat.run.estimates import estimates_of

if TYPE_CHECKING:
    from barbalat.run.result import Result

WITHIN_REACH, BOUNDS_WITHIN_REACH = 1.5, 0.4
"""Heights of what must be seen: a limit or true value, or a bound of the known set, that is farther away is said, not drawn."""
FLAT_SHARE = 0.12
"""Part of the largest motion of an estimate below which another one's line would be flat: it gets axes with others like it."""
MOST_BOUNDED = 3
"""Estimates with bounds of their own that can be told apart in one panel."""


def estimates_panels(result: Result, title: str) -> list[Panel]:
    """One, or two where some estimates move so little beside the others that their lines would be flat."""
    large, small = _by_size(result)
    if not small:
        return [_panel(result, title, large)] if large else []
    return [_panel(result, title, large), _panel(result, f"{title}, the smaller ones", small)]


def _by_size(result: Result) -> tuple[list[int], list[int]]:
    """Indices of the estimates: those with the largest motion, and those with less than ``FLAT_SHARE`` of it."""
    moved = [span_of([one.value]) for one in estimates_of(result)]
    heights = [high - low for low, high in moved]
    flat = [result.diverged_at is None and 0 < height < FLAT_SHARE * max(heights) for height in heights]
    return [i for i, one in enumerate(flat) if not one], [i for i, one in enumerate(flat) if one]


def _panel(result: Result, title: str, chosen: Sequence[int]) -> Panel:
    estimates = [estimates_of(result)[i] for i in chosen]
    series = [
        Series(
            t=result.t, value=one.value, label=one.label, colour=i, dash=0, low=one.low, high=one.high,
            width=width_of(k, len(chosen)),
        )
        for k, (i, one) in enumerate(zip(chosen, estimates, strict=True))
    ]  # fmt: skip
    levels = [
        Level(value=one.true, colour=i, dash=1, label="true values", of=k)
        for k, (i, one) in enumerate(zip(chosen, estimates, strict=True))
        if one.true is not None
    ]
    bounds = _bounds(result, result.theta_hat.shape[1])
    bounds = [bounds[one.number] for one in estimates if one.number is not None] if bounds else []
    moved = span_of([part for s in series for part in (s.value, s.low, s.high) if part is not None])
    near, beyond = reachable([level.value for level in levels], moved)
    needed = span_of([np.array([*moved, *near])])
    marks, far = _edges_of_known_set(bounds, needed, chosen)
    outside = [one for one in estimates if one.true is not None and one.true not in near]
    away = ", ".join(_held(f"${one.symbol}$ = {one.true:.4g}") for one in outside)
    said = [f"true values outside: {away}"] if beyond else []
    said += [f"known set: {_interval_text(bounds)}"] if far else []
    shown = span_of([np.array([*needed, *(mark.value for mark in marks)])])
    return Panel(
        title=title,
        series=series,
        levels=[*levels, *marks],
        limits=around(*shown) if result.diverged_at is None else None,
        scale=scale_of(result),
        note="; ".join(said),
        may_part=True,
    )


def scale_of(result: Result) -> str:
    """Of the axes for a run that may have diverged: the burst would hide what led to it."""
    return "linear" if result.diverged_at is None else "symlog"


def _edges_of_known_set(
    bounds: Sequence[tuple[float, float]], needed: tuple[float, float], chosen: Sequence[int]
) -> tuple[list[Level], bool]:
    """Those that can be drawn beside what must be seen, and whether others are left out."""
    common = len(set(bounds)) == 1
    drawn, far = reachable([bound for pair in bounds for bound in pair], needed, BOUNDS_WITHIN_REACH)
    if not common and len(chosen) > MOST_BOUNDED:
        drawn, far = [], bool(bounds)
    marks = [
        Level(value=bound, colour="quiet" if common else chosen[k], dash=2, label="known set", of=None if common else k)
        for k, pair in enumerate(bounds[:1] if common else bounds)
        for bound in pair
        if bound in drawn
    ]
    return marks, far


def _bounds(result: Result, p: int) -> list[tuple[float, float]]:
    """The known set's extent for each estimate; nothing where there is none."""
    found = _set_of(result)
    if found is None:
        return []
    lower, upper = found.extent
    return [(float(a), float(b)) for a, b in zip(lower, upper, strict=True)] if len(lower) == p else []


def _set_of(result: Result) -> EstimateSet | None:
    """What the scheme projects onto, else what is known."""
    kept = estimate_set(result.loop)
    if kept is not None:
        return kept
    return result.problem.known.estimate_set if isinstance(result.problem, Problem) else None


def reachable(ends: Sequence[float], needed: tuple[float, float], within: float = WITHIN_REACH) -> tuple[list[float], bool]:
    """Those ends that can be drawn without pressing flat what must be seen, and whether others are left out."""
    room = within * ((needed[1] - needed[0]) or abs(needed[1]) or 1.0)
    real = sorted({end for end in ends if abs(end) < UNREACHED_BOUND})
    drawn = [end for end in real if needed[0] - room <= end <= needed[1] + room]
    return drawn, len(drawn) < len(real)


def _interval_text(bounds: Sequence[tuple[float, float]]) -> str:
    several = [_held(f"{a:g} … {b:g}") if max(-a, b) < UNREACHED_BOUND else "open" for a, b in dict.fromkeys(bounds)]
    return ", ".join(several) if len(several) <= 3 else f"{', '.join(several[:3])}, …"


def _held(text: str) -> str:
    """With blanks at which no line ends."""
    return text.replace(" ", "\N{NO-BREAK SPACE}")
