"""The outcome of a run in a few words, as a small table, and for a notebook."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from barbalat.problem.labels import Labels
from barbalat.problem.tracking import TrackingProblem
from barbalat.run.results.estimates import MOST_REPORTED

if TYPE_CHECKING:
    from barbalat.run.results.result import Result

Figure = float | list[float] | None
"""A metric, or its components; None if there is no finite value."""
FIGURE_LABELS = {
    "max_abs_e": "max |e|",
    "rms_e": "RMS e",
    "tail_max_abs_e": "max |e| in the tail",
    "max_abs_u": "max |u|",
    "theta_hat_final": "estimates at the end",
}
"""The displayed metrics, by their names in JSON."""


DEMAND = "u is the demand: before the limits, the gain, the dynamics and the delay of the plant's input"


def about_u(problem: TrackingProblem) -> str | None:
    """The note about u in a table of metrics, if something other than u reaches the plant."""
    return DEMAND if any(path.path is not None or path.delay > 0 for path in problem.surroundings.paths) else None


def outcome(run: Result) -> str:
    """The outcome of a run, on one line."""
    if run.diverged_at is not None:
        return f"diverged at t = {run.diverged_at:.4g} s"
    shown = ("max_abs_e", "tail_max_abs_e", "max_abs_u")
    label = [] if run.label is None else [run.label]
    return "; ".join([*(f"{FIGURE_LABELS[name]} {text_of(run.figures[name])}" for name in shown), *label])


def outcome_in_brief(run: Result) -> str:
    """The outcome in a few words, for one line: whether it diverged, or the judge's verdict if there is one."""
    if run.diverged_at is not None:
        return f"diverged at t = {run.diverged_at:.4g} s"
    if run.verdict is not None:
        return str(run.verdict)
    return f"{FIGURE_LABELS['max_abs_e']} {text_of(run.figures['max_abs_e'])}"


def text_of(value: float | list[float] | None) -> str:
    """A metric, or its components in brackets, with four digits."""
    if isinstance(value, list):
        return text_of(value[0]) if len(value) == 1 else f"[{', '.join(map(text_of, value))}]"
    return "-" if value is None else f"{value:.4g}"


def ends_of(run: Result, text: Callable[[Figure], str] | None = None) -> str:
    """The final estimates: first theta_hat, then other adapted quantities by name; if there are many, only the largest."""
    text = text or text_of
    ends = {name.removesuffix("_hat_final"): value for name, value in run.figures.items() if name.endswith("_hat_final")}
    theta = ends.pop("theta", None)
    own = [text(theta)] if theta or not ends else []
    return "; ".join([*own, *(f"{name} {_end(value, text)}" for name, value in ends.items())]).replace("[]", "-")


def _end(value: Figure, text: Callable[[Figure], str]) -> str:
    entries = np.ravel([] if value is None else value)
    if len(entries) <= MOST_REPORTED:
        return text(value)
    return f"{np.abs(entries).max():.4g}, the largest of {len(entries)} entries"


def units_of(labels: Labels | None) -> dict[str, str]:
    """The units of metrics by their names, in brackets, if the case gives them."""
    if labels is None:
        return {}
    return dict.fromkeys(("max_abs_e", "rms_e", "tail_max_abs_e"), labels.every_unit) | {"max_abs_u": labels.every_input_unit}


def table(runs: Iterable[Result], labels: Labels | None = None) -> str:
    """The metrics of runs as an HTML table, a row for each."""
    from html import escape

    units = units_of(labels)
    said = (escape(f"{text} {units.get(name, '')}".rstrip()) for name, text in FIGURE_LABELS.items())
    head = "".join(f'<th scope="col">{text}</th>' for text in ("controller", *said))
    return f"<table><tr>{head}</tr>{''.join(_row(escape(run.name), run) for run in runs)}</table>"


def _row(name: str, run: Result) -> str:
    if run.diverged_at is not None:
        return (
            f'<tr><th scope="row">{name}</th><td colspan="{len(FIGURE_LABELS)}">diverged at t = {run.diverged_at:.4g} s</td></tr>'
        )
    shown = (ends_of(run) if key == "theta_hat_final" else text_of(run.figures[key]) for key in FIGURE_LABELS)
    cells = "".join(f"<td>{text}</td>" for text in shown)
    return f'<tr><th scope="row">{name}</th>{cells}</tr>'


def html_of(results: Sequence[Result]) -> str:
    """The display of runs in a notebook: the verdicts, the metrics as a table, the findings, the plot."""
    from html import escape

    from barbalat.pictures.plotted import image_of
    from barbalat.run.results.picture import figure_of

    if not results:
        return "<p>no runs</p>"
    several = len(results) > 1
    said = about_u(results[0].problem)
    notes = [escape(said)] if said is not None else []
    notes += [
        escape(f"{result.name}: {sentence}" if several else sentence)
        for result in results
        for sentence in (result.numerics, *result.warnings)
    ]
    picture = image_of(figure_of(results), f"{', '.join(result.name for result in results)} over time")
    verdicts = "<br>".join(escape(f"{result.name}: {result.verdict}") for result in results if result.verdict is not None)
    return f"<p>{verdicts}</p>{table(results, results[0].problem.labels)}<small>{'<br>'.join(notes)}</small><br>{picture}"
