"""Plots of runs: the trajectory with model and command, errors, controls, estimates and their known set."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from barbalat.judge.settings import LOST_SHARE, component_names
from barbalat.judge.verdict import Class
from barbalat.loop.true_values import estimate_set
from barbalat.pictures.close_ups import close_ups
from barbalat.pictures.panels import Level, Panel, Series, around, as_typed, chosen, span_of, text_of, width_of
from barbalat.problem.command_gain import FOLLOWS_TO, commanded, gains_at_rest
from barbalat.problem.known_set import UNREACHED_BOUND, EstimateSet
from barbalat.problem.labels import UNLABELLED
from barbalat.problem.output_feedback import OutputProblem
from barbalat.problem.state_feedback import Problem
from barbalat.run.results.estimates import estimates_of
from barbalat.run.results.outcome import outcome_in_brief
from barbalat.validate import Array, InputError, counted, show

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from barbalat.run.results.result import Result

WITHIN_REACH, BOUNDS_WITHIN_REACH = 1.5, 0.4
"""Multiples of the height of the main curves: a limit, true value or bound of the known set that is farther away is stated in
text instead of being drawn."""
FLAT_SHARE = 0.12
"""Fraction of the largest motion of an estimate below which another estimate's line would be flat; such estimates are drawn in
separate axes."""
MOST_BOUNDED = 3
"""Largest number of estimates with bounds that are distinguishable in one panel."""


def estimates_panels(result: Result, title: str) -> list[Panel]:
    """One panel, or two if some estimates would be flat lines because they move little compared with others."""
    large, small = _by_size(result)
    if not small:
        return [_panel(result, title, large)] if large else []
    return [_panel(result, title, large), _panel(result, f"{title}, the smaller ones", small)]


def _by_size(result: Result) -> tuple[list[int], list[int]]:
    """Indices of the estimates that move most, and of those that move less than ``FLAT_SHARE`` of that."""
    moved = [span_of([one.value]) for one in estimates_of(result)]
    heights = [high - low for low, high in moved]
    flat = [not _gone(result) and 0 < height < FLAT_SHARE * max(heights) for height in heights]
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
        limits=None if _gone(result) else around(*shown),
        scale=scale_of(result),
        note="; ".join(said),
        may_part=True,
        names=("estimates", result.name),
    )


def scale_of(result: Result) -> str:
    """The scale of the axes: a symmetric logarithm for a run that has diverged, because the burst would hide what precedes it."""
    return "symlog" if _gone(result) else "linear"


def _gone(result: Result) -> bool:
    """Whether a run diverged or exceeded its limits by a large factor. Shared panels then use the scale that the other runs
    need."""
    verdict, figures = result.verdict, result.figures["max_abs_e"]
    if result.diverged_at is not None or verdict is None or verdict.kind is not Class.LOST:
        return result.diverged_at is not None
    names = component_names(result.problem)
    reached = figures[names.index(verdict.component)] if isinstance(figures, list) else None
    return reached is None or reached > LOST_SHARE * verdict.scale


def _edges_of_known_set(
    bounds: Sequence[tuple[float, float]], needed: tuple[float, float], chosen: Sequence[int]
) -> tuple[list[Level], bool]:
    """The bounds of the known set that can be drawn together with the curves, and whether others are omitted."""
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
    """The known set's extent for each estimate; empty without a set."""
    found = _set_of(result)
    if found is None:
        return []
    lower, upper = found.extent
    return [(float(a), float(b)) for a, b in zip(lower, upper, strict=True)] if len(lower) == p else []


def _set_of(result: Result) -> EstimateSet | None:
    """The set onto which the scheme projects, or else the known set."""
    kept = estimate_set(result.loop)
    if kept is not None:
        return kept
    return result.problem.known.estimate_set if isinstance(result.problem, Problem) else None


def reachable(ends: Sequence[float], needed: tuple[float, float], within: float = WITHIN_REACH) -> tuple[list[float], bool]:
    """The values that can be drawn without flattening the curves, and whether others are omitted."""
    room = within * ((needed[1] - needed[0]) or abs(needed[1]) or 1.0)
    real = sorted({end for end in ends if abs(end) < UNREACHED_BOUND})
    drawn = [end for end in real if needed[0] - room <= end <= needed[1] + room]
    return drawn, len(drawn) < len(real)


def _interval_text(bounds: Sequence[tuple[float, float]]) -> str:
    several = [_held(f"{a:g} … {b:g}") if max(-a, b) < UNREACHED_BOUND else "open" for a, b in dict.fromkeys(bounds)]
    return ", ".join(several) if len(several) <= 3 else f"{', '.join(several[:3])}, …"


def _held(text: str) -> str:
    """The text with non-breaking spaces."""
    return text.replace(" ", "\N{NO-BREAK SPACE}")


ERROR_WINDOWS = 150
"""Number of intervals of the run: the largest error in each gives a readable line on a logarithmic axis."""
LARGEST_SHOWN = 20
"""Multiple of the largest error of the bounded runs up to which a diverging run is drawn, so that the others can be told
apart."""


def figure_of(
    results: Sequence[Result],
    *,
    names: str | Iterable[str] | None = None,
    axes: Axes | Iterable[Axes] | None = None,
    narrow: bool = False,
    shown: bool = False,
) -> Figure:
    """Draw the runs of one problem in common panels.

    names   names of the panels to draw; all by default
    axes    axes to draw into, one for each panel; by default the axes of a new figure
    narrow  whether to stack the panels, for a phone or a column of a page
    shown   whether to display the figure at once, if pyplot is in use
    """
    from matplotlib.axes import Axes  # importing it takes longer than a run, and pages do not need it

    from barbalat.pictures.panel_drawing import draw, draw_into

    drawn = panels(results) if names is None else chosen(panels(results), names)
    if axes is None:
        return draw(drawn, ends_at(results), narrow=narrow, shown=shown)
    places = [one for one in np.asarray(axes, dtype=object).ravel() if isinstance(one, Axes)]
    if len(places) != len(drawn) or len(places) != np.size(np.asarray(axes, dtype=object)):
        titles = ", ".join(panel.names[0] for panel in drawn)
        raise InputError.of("axes", f"must be {counted(len(drawn), 'pair')} of Matplotlib's axes, for {titles}, got {show(axes)}")
    draw_into(places, drawn, ends_at(results))
    figure = places[0].get_figure(root=True)
    assert figure is not None  # only these panels are drawn
    return figure


def ends_at(results: Sequence[Result]) -> float:
    """The end of the longest run [s]."""
    return max(result.simulation.t_end for result in results)


def panels(results: Sequence[Result]) -> list[Panel]:
    """The panels that all runs share, followed by each run's error and estimates."""
    if len(results) == 1:
        (result,) = results
        own = [_error(result, "Tracking error"), _control(results), *estimates_panels(result, "Estimates")]
        return [*_tracking(results), *own]
    found = [*_tracking(results), _largest_error(results), _control(results)]
    for result in results:
        name = text_of(result.name)
        found += [_error(result, f"{name}: tracking error"), *estimates_panels(result, f"{name}: estimates")]
    return found


def _tracking(results: Sequence[Result]) -> list[Panel]:
    """A panel for each commanded state, or for the output."""
    problem = results[0].problem
    output, labels = isinstance(problem, OutputProblem), problem.labels or UNLABELLED
    gains = gains_at_rest(problem)
    found = []
    for state, commands in commanded(problem):
        model = "y_m" if output else f"x_{{m,{state + 1}}}"
        longest = max(results, key=lambda result: len(result.t))
        runs = [_motion(result, state, k, width_of(k, len(results))) for k, result in enumerate(results)]
        value = np.asarray(longest.x_m[:, state] if longest.y is None else longest.y - longest.e[:, 0])
        others = [Series(t=longest.t, value=value, label=f"model ${model}$", colour="ink", dash=1)]
        others += [_command(longest, k, float(gains[state, k])) for k in commands]
        note = _settles_at(gains, state, commands)
        title = "Output $y$" if output else f"State $x_{state + 1}$"
        title += f" = {text_of(labels.name(state))}" if labels.name(state) else ""
        names = ("motion", "y" if output else f"x_{state + 1}", *([labels.name(state)] if labels.name(state) else []))
        y = f"{'$y$' if output else f'$x_{state + 1}$'} {as_typed(labels.unit(state))}"
        limits = _limits_with_lost_runs(results, [s.value for s in runs], [s.value for s in others])
        whole = Panel(
            title=f"{title}, model and command",
            series=[*runs, *others],
            note=note,
            limits=limits,
            whole_row=True,
            y=y,
            names=names,
        )
        found += [whole, *close_ups(whole, others, longest.simulation.t_end)]
    return found


def _settles_at(gains: Array, state: int, commands: Sequence[int]) -> str:
    """The steady state of a model's state for constant commands, if it differs from the command."""
    several = gains.shape[1] > 1
    off = {f"$r_{k + 1}$" if several else "$r$": float(gains[state, k]) for k in commands}
    parts = [f"{gain:.4g} {name}" for name, gain in off.items() if abs(gain - 1) > FOLLOWS_TO]
    if not parts:
        return ""
    names = ", ".join(off)
    alone = " (the others at zero)" if several else ""
    return f"for a constant command {names}{alone} the model settles at {', '.join(parts)}, not at {names}"


def _command(result: Result, k: int, gain: float) -> Series:
    """A command scaled to the model's steady-state response."""
    r = result.r[:, None] if result.r.ndim == 1 else result.r
    name = f"$r_{k + 1}$" if r.shape[1] > 1 else "$r$"
    follows = abs(gain - 1) <= FOLLOWS_TO
    label = f"command {name}" if follows else f"{gain:.4g} × command {name}"
    return Series(t=result.t, value=r[:, k] * (1.0 if follows else gain), label=label, colour="quiet", dash=2)


def _motion(result: Result, state: int, k: int, width: float) -> Series:
    """The state or output of a run, widened between the instants by the extrema of the error."""
    value, e = result.x[:, state] if result.y is None else result.y, result.e[:, state]
    below = np.minimum(e[:-1], e[1:]) - result.envelope.e_min[:, state]
    above = result.envelope.e_max[:, state] - np.maximum(e[:-1], e[1:])
    low = np.minimum(value[:-1], value[1:]) - np.maximum(below, 0)
    high = np.maximum(value[:-1], value[1:]) + np.maximum(above, 0)
    return Series(t=result.t, value=value, label=text_of(result.name), colour=k, low=low, high=high, width=width)


def _largest_error(results: Sequence[Result]) -> Panel:
    """The largest |e_i| in windows of the run, on a logarithmic axis."""
    width = results[0].simulation.t_end / ERROR_WINDOWS
    series = []
    for k, result in enumerate(results):
        largest = np.maximum(np.abs(result.envelope.e_min), np.abs(result.envelope.e_max)).max(axis=1)
        if len(largest) == 0:
            continue
        starts = np.unique(np.searchsorted(result.t[:-1], np.linspace(0, result.simulation.t_end, ERROR_WINDOWS, endpoint=False)))
        starts = starts[starts < len(largest)]
        value = np.maximum(np.maximum.reduceat(largest, starts), np.finfo(float).tiny)
        name = text_of(result.name)
        series.append(Series(t=result.t[starts], value=value, label=name, colour=k, width=width_of(k, len(results))))
    tops = [float(s.value.max()) for s, result in zip(series, results, strict=False) if not _gone(result)]
    bottom = min((float(np.quantile(s.value, 0.02)) for s in series), default=1.0)
    top = max(tops, default=0.0)
    limits = (max(bottom, 1e-9 * top) / 2, (LARGEST_SHOWN if len(tops) < len(series) else 2) * top) if 0 < bottom < top else None
    gone = ", ".join(text_of(result.name) for result in results if _gone(result))
    note = f"lost, beyond the upper edge: {gone}" if gone and limits is not None else ""
    return Panel(
        title=f"Largest $|e_i|$ in each {width:.3g} s",
        series=series,
        scale="log",
        limits=limits,
        note=note,
        names=("largest error",),
    )


def _control(results: Sequence[Result]) -> Panel:
    series = [one for k, result in enumerate(results) for one in _inputs(result, k, len(results))]
    paths = results[0].problem.surroundings.paths
    ends = sorted({float(end) for path in paths if path.saturation is not None for end in path.saturation})
    of_each = [np.concatenate([s.low, s.high]) if s.low is not None and s.high is not None else s.value for s in series]
    limits = _limits_with_lost_runs([r for r in results for _ in range(len(series) // len(results))], of_each, [])
    drawn, far = reachable(ends, limits or span_of(of_each))
    note = f"actuator limits: {', '.join(f'{end:g}' for end in ends)}" if far else ""
    levels = [Level(value=end, label="actuator limit") for end in drawn]
    limits = around(*span_of([np.array([*(limits or span_of(of_each)), *drawn])])) if drawn else limits
    unit = as_typed((results[0].problem.labels or UNLABELLED).input_unit)
    return Panel(title="Control $u$", series=series, levels=levels, note=note, limits=limits, y=f"$u$ {unit}", names=("control",))


def _inputs(result: Result, k: int, count: int) -> list[Series]:
    """Draws the controls of the k-th of ``count`` runs."""
    u = result.u[:, None] if result.u.ndim == 1 else result.u
    low, high = (side.reshape(len(u) - 1, u.shape[1]) for side in (result.envelope.u_min, result.envelope.u_max))
    several, found = u.shape[1] > 1, []
    for j in range(u.shape[1]):
        symbol = f"$u_{j + 1}$" if several else "$u$"
        label = symbol if count == 1 else f"{text_of(result.name)}, {symbol}" if several else text_of(result.name)
        ends, dash = (low[:, j], high[:, j]), j if several else None
        found.append(
            Series(
                t=result.t, value=u[:, j], label=label, colour=k, dash=dash, low=ends[0], high=ends[1], width=width_of(k, count)
            )
        )
    return found


def _limits_with_lost_runs(
    results: Sequence[Result], of_each: Sequence[Array], of_all: Sequence[Array]
) -> tuple[float, float] | None:
    """The range needed by the runs that have not diverged; ``None`` if no run or every run diverged."""
    bounded = [value for result, value in zip(results, of_each, strict=True) if not _gone(result)]
    if not bounded or len(bounded) == len(of_each):
        return None
    low, high = span_of([*bounded, *of_all])
    return low - 0.25 * (high - low), high + 0.25 * (high - low)


def _error(result: Result, title: str) -> Panel:
    n, labels = result.e.shape[1], result.problem.labels or UNLABELLED
    units = [f" {as_typed(labels.unit(i))}" if labels.unit(i) and not labels.common_unit else "" for i in range(n)]
    series = [
        Series(
            t=result.t, value=result.e[:, i], label=f"{'$e$' if n == 1 else f'$e_{i + 1}$'}{units[i]}", colour=i,
            low=result.envelope.e_min[:, i], high=result.envelope.e_max[:, i], width=width_of(i, n),
        )
        for i in range(n)
    ]  # fmt: skip
    meaning = "$e = x - x_m$" if result.y is None else "$e = y - y_m$"
    return Panel(
        title=f"{title} {meaning}",
        series=series,
        scale=scale_of(result),
        note=f"{outcome_in_brief(result)}; logarithmic beyond 1" if _gone(result) else "",
        names=("error", result.name),
        y=f"$e$ {as_typed(labels.common_unit)}",
    )
