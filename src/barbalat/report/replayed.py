"""A recording that was replayed through the estimators of a case: on the screen, as JSON and as panels of a page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from barbalat.pictures.panels import Level, Panel, Series, span_of, text_of
from barbalat.pictures.symbols import number_text
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.state_feedback import Problem
from barbalat.report.terminal.layout import Screen
from barbalat.roles import hatted
from barbalat.run.results.estimates import label_of
from barbalat.run.results.picture import reachable
from barbalat.study.replay import Replay
from barbalat.validate import Array


def known_ends(problem: Problem, size: int) -> tuple[Array, Array] | None:
    """Return the ends of the known set for this number of estimates, or None if the set is not a box of that size."""
    known = problem.known.estimate_set
    return (np.asarray(known.lower), np.asarray(known.upper)) if isinstance(known, ParameterBox) and known.size == size else None


def as_json(found: Mapping[str, Replay], problem: Problem) -> dict[str, Any]:
    """Return, for each controller, the block of ``run --json`` on its estimates, and its control compared with the recorded
    control."""
    told = {}
    for name, one in found.items():
        ends = known_ends(problem, one.theta_hat.shape[1])
        told[name] = {
            "theta_hat_final": one.theta_hat[-1].tolist(),
            "theta_hat_tail_min": one.tail.min(axis=0).tolist(),
            "theta_hat_tail_max": one.tail.max(axis=0).tolist(),
            "known_set": None if ends is None else [list(pair) for pair in zip(*(end.tolist() for end in ends), strict=True)],
            "rms_u_difference": one.apart,
            "rms_u_flown": _rms(one.flown),
            "t": one.times.tolist(),
            "theta_hat": one.theta_hat.tolist(),
        }
    return {"samples": len(next(iter(found.values())).times), "controllers": told}


COLUMNS = ("controller", "estimate", "at the end", "last quarter", "known set")


def rows(found: Mapping[str, Replay], problem: Problem) -> list[list[str]]:
    """Return rows with the final estimates of each controller, the estimates over the last quarter, and the known set."""
    told = []
    for name, one in found.items():
        ends = known_ends(problem, one.theta_hat.shape[1])
        for i, values in enumerate(one.theta_hat.T):
            known = "" if ends is None else f"{ends[0][i]:.4g} to {ends[1][i]:.4g}"
            tail = f"{one.tail[:, i].min():.4g} to {one.tail[:, i].max():.4g}"
            told.append(["" if i else name, hatted(one.names[i]), number_text(float(values[-1])), tail, known])
    return told


def title(found: Mapping[str, Replay], problem: Problem) -> str:
    """Return a title with the case and the number of replayed samples."""
    return f"{problem.name}: {len(next(iter(found.values())).times)} recorded samples replayed through its estimators"


def sentences(found: Mapping[str, Replay]) -> list[str]:
    """Return sentences on the distance between each controller's control and the recorded control, and warnings on the
    estimates."""
    apart = [
        f"The u of {name} differs from the recorded u by {one.apart:.3g} (RMS; the RMS of the recorded u is "
        f"{_rms(one.flown):.3g})."
        for name, one in found.items()
    ]
    return [*apart, "An estimator may reproduce the recording even though its estimates are not the parameters of the plant."]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def show(found: Mapping[str, Replay], problem: Problem, screen: Screen) -> None:
    """Print the final estimates and those over the last quarter with the known set, and then the sentences on the controls."""
    screen.title(title(found, problem))
    screen.table(list(COLUMNS), rows(found, problem), leads=2)
    *apart, last = sentences(found)
    for said in apart:
        screen.line(said, start="- ")
    screen.line(last)


def panels(found: Mapping[str, Replay], problem: Problem) -> list[Panel]:
    """Return the panels: for each controller, its estimates, each on separate axes, and its controls with the recorded
    controls."""
    shown = []
    for name, one in found.items():
        ends = known_ends(problem, one.theta_hat.shape[1])
        shown += [
            _estimate(name, one.names[i], i, one.times, values, None if ends is None else (float(ends[0][i]), float(ends[1][i])))
            for i, values in enumerate(one.theta_hat.T)
        ]
        for j, (flown, proposed) in enumerate(zip(one.flown.T, one.proposed.T, strict=True)):
            both = [
                Series(t=one.times, value=flown, label="recorded", colour="quiet", dash=0),
                Series(t=one.times, value=proposed, label=text_of(name), colour=0, dash=0),
            ]
            which = "u" if one.flown.shape[1] == 1 else f"u_{j + 1}"
            shown.append(Panel(title=text_of(f"{name}: {which} from the recorded state"), series=both, whole_row=True))
    return shown


def _estimate(name: str, of: str, i: int, t: Array, values: Array, known: tuple[float, float] | None) -> Panel:
    """Return the panel of one estimate, with the ends of the known set that are near its motion, or with a note on both ends."""
    near, beyond = reachable([] if known is None else list(known), span_of([values]))
    label = label_of(of)
    return Panel(
        title=text_of(f"{name}: ") + label,
        series=[Series(t=t, value=values, label=label, colour=i, dash=0)],
        levels=[Level(value=end, colour=i, label="known set") for end in near],
        note="" if known is None or not beyond else f"known set: {known[0]:.4g} to {known[1]:.4g}",
    )
