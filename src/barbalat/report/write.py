"""Writes the commands' output files: pictures, pages, JSON and trajectories."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from typing import Protocol

import numpy as np
from matplotlib.figure import Figure

from barbalat.comparison.contest.picture import draw as draw_contest
from barbalat.comparison.contest.result import Contest
from barbalat.comparison.design.design import Design
from barbalat.comparison.tradeoff.picture import draw as draw_trade_off
from barbalat.comparison.tradeoff.tradeoff import TradeOff
from barbalat.comparison.tune.picture import draw as draw_tuning
from barbalat.comparison.tune.result import Tuning
from barbalat.folders import Folder
from barbalat.identify.picture import draw as draw_identification
from barbalat.identify.result import Identification
from barbalat.papers.claim import Chart, Claim, Map
from barbalat.papers.paper import PaperFigure
from barbalat.pictures.panel_drawing import draw as draw_panels
from barbalat.pictures.render import render
from barbalat.problem.state_feedback import Problem
from barbalat.processes import answer_of
from barbalat.report import flights, maps, page, replayed
from barbalat.report.drawings import ReportFigure, narrow_panels, svg_of
from barbalat.report.file_names import NARROW, PAGE, TUNED_CASE
from barbalat.report.sweep import WorstMember
from barbalat.run.results.picture import ends_at, figure_of, panels
from barbalat.run.results.result import Result
from barbalat.study.replay import Replay
from barbalat.sweeps import picture as of_sweep
from barbalat.sweeps.result import SweepResult
from barbalat.vehicles.comparison import FlightComparison
from barbalat.vehicles.film import film
from barbalat.vehicles.picture import paths_figure
from barbalat.vehicles.vehicle import vehicles


class Drawn(Protocol):
    """Anything that draws one figure, for a page or for a phone."""

    def __call__(self, *, narrow: bool) -> Figure: ...


def draw_reproduction(folder: Folder, figures: Sequence[PaperFigure], drawn: Callable[[float], None]) -> dict[str, ReportFigure]:
    """Draw every figure, except those for phones, into the folder. ``drawn`` is called after each figure with its fraction of the
    work."""
    pictures = {}
    for figure in figures:
        pictures[figure.key] = _draw(folder, f"figure-{figure.key}", figure_of(figure.shown))
        drawn(1 / len(figures))
    return pictures


class NarrowPictures:
    """The figures for phones. A second process draws them, beginning with the first, while this process does other work."""

    def __init__(self, figures: Sequence[PaperFigure], beside: Executor) -> None:
        self.given = {figure.key: (f"figure-{figure.key}", panels(figure.shown), ends_at(figure.shown)) for figure in figures}
        self.asked = {key: beside.submit(narrow_panels, *given) for key, given in self.given.items()}

    def joined(self, pictures: Mapping[str, ReportFigure]) -> dict[str, ReportFigure]:
        """Return both versions of each figure, by key. Figures that have not been started are drawn in this process, the last one
        first."""
        found = {key: answer_of(self.asked[key], narrow_panels, *self.given[key]) for key in reversed(self.given)}
        return {key: replace(picture, narrow=found[key]) for key, picture in pictures.items()}


def keep(folder: Folder, pictures: Sequence[ReportFigure]) -> None:
    """Write the SVGs of pictures that another process has drawn."""
    for picture in pictures:
        for drawing in (picture.wide, picture.narrow):
            if drawing is not None:
                folder.write(drawing.file, drawing.svg)


def draw_maps(folder: Folder, claims: Sequence[Claim]) -> dict[str, ReportFigure]:
    """Draw every map and chart of the claims into the folder. Return the pictures by key."""
    return {shown.key: _draw_both(folder, f"map-{shown.key}", partial(_map, shown)) for claim in claims for shown in claim.maps}


def _map(shown: Map | Chart, *, narrow: bool) -> Figure:
    return maps.draw(shown, narrow=narrow) if isinstance(shown, Map) else maps.draw_chart(shown, narrow=narrow)


def write_tradeoff(folder: Folder, found: TradeOff) -> None:
    """Write the picture and the page of a trade-off."""
    picture = _draw_both(folder, "tradeoff", partial(draw_trade_off, found))
    folder.write(PAGE, page.trade_off(found, picture))


def write_sweep(
    folder: Folder, found: SweepResult, worst: Sequence[WorstMember] = (), runs: Mapping[str, tuple[int, Result]] | None = None
) -> None:
    """Write the page of a sweep (see ``page.sweep``) and its pictures: members by verdict, histograms, a map over two axes, and
    sensitivities.

    runs  number of the worst member and its run, by controller
    """
    pictures = {"histograms": _draw_both(folder, "histograms", partial(of_sweep.histograms, found))}
    if runs:
        shown = [_worst_run(found, controller, member, result) for controller, (member, result) in runs.items()]
        pictures["verdicts"] = _draw_both(folder, "verdicts", partial(of_sweep.members_by_verdict, found, shown))
    figures = [name for name in found.evidence.metrics if name.startswith("max_abs_e[")]
    for name in figures[:1]:
        heat = of_sweep.heat_of(found, name)
        if heat is not None:
            logarithmic = [axis.logarithmic for axis in found.plan.axes.values()]
            drawing = partial(of_sweep.heat_map, heat, f"median of {of_sweep.symbol(name)}", (logarithmic[0], logarithmic[1]))
            pictures["map"] = _draw_both(folder, "map", drawing)
        own = [one for one in found.evidence.sensitivities if one.figure == name]
        if own:
            pictures["tornado"] = _draw_both(folder, "tornado", partial(of_sweep.tornado, own, found.controllers, name))
    folder.write(PAGE, page.sweep(found, pictures, worst))


def _worst_run(found: SweepResult, controller: str, member: int, result: Result) -> of_sweep.WorstRun:
    """Return the run together with the first panel of its page. A diverging run is cut off so that the model remains visible."""
    panel, *_ = panels([result])
    title = f"{controller}, the worst: member {member}, {found.kind_of(controller, member)}"
    motion, *others = panel.series
    reached, asked = (max(float(np.nanmax(np.abs(one.value), initial=0.0)) for one in some) for some in ([motion], others))
    limits = (-RUNAWAY_SHOWN * asked, RUNAWAY_SHOWN * asked) if reached > 5 * RUNAWAY_SHOWN * asked > 0 else panel.limits
    return of_sweep.WorstRun(controller, member, replace(panel, title=title, limits=limits), ends_at([result]))


RUNAWAY_SHOWN = 4.0
"""A lost run is shown up to this multiple of the largest value of model and command."""


def write_flights(folder: Folder, found: FlightComparison) -> None:
    """Write for each failure the pictures over time and in space and a CSV, a film of one failure, and the page, which contains
    all pictures."""
    pictures, paths = {}, {}
    for failure in found.failures:
        name = f"flight-{failure.name}"
        pictures[failure.name] = _within(folder, name, partial(found.figure, failure))
        scene = found.scene(failure, found.controllers)
        if scene is not None:
            paths[failure.name] = _within(folder, name.replace("flight", "path"), partial(paths_figure, scene))
        folder.write(f"{name}.csv", flights.table_of(found, failure))
    told = found.most_telling
    scene = found.scene(told, found.pair(told))
    shown = None if scene is None else page.Film(FILM, told.meaning, film(scene))
    if shown is not None:
        folder.write(FILM, shown.gif)
    folder.write(PAGE, page.flight(found, pictures, paths, shown))


FILM = "flight.gif"


def _within(folder: Folder, name: str, figure: Drawn) -> ReportFigure:
    """Write the wide version as PNG. Both versions are returned as SVG, for the page only."""
    wide, narrow = (figure(narrow=narrow) for narrow in (False, True))
    folder.write(f"{name}.png", render(wide, "png"))
    return ReportFigure(svg_of(name, wide), svg_of(f"{name}{NARROW}", narrow))


def files_of_flights() -> set[str]:
    """Return the names of files that ``barbalat fly`` may have left in a folder, besides the files that it always writes."""
    names = {failure.name for vehicle in vehicles().values() for failure in vehicle.failures}
    return {FILM, *(f"{what}-{name}.{kind}" for name in names for what in ("flight", "path") for kind in ("png", "csv"))}


def write_tuning(folder: Folder, found: Tuning) -> None:
    """Write the case file if there is one, the picture of the fronts, and the page."""
    if found.text is not None:
        folder.write(TUNED_CASE, found.text)
    picture = _draw_both(folder, "front", partial(draw_tuning, found)) if found.aim.constraints else None
    folder.write(PAGE, page.tuning(found, picture))


def write_contest(folder: Folder, found: Contest) -> None:
    """Write the picture of the validation runs, if there are any, and the page."""
    picture = _draw_both(folder, "contest", partial(draw_contest, found)) if found.held_out else None
    folder.write(PAGE, page.contest(found, picture))


def write_design(folder: Folder, found: Design, *, explorer: str | None, files: Sequence[str], text: str | None) -> None:
    """Write the page of the design, and the page and the picture of its contest."""
    picture = _draw_both(folder, "contest", partial(draw_contest, found.contest)) if found.contest.held_out else None
    folder.write("contest.html", page.contest(found.contest, picture))
    folder.write(PAGE, page.design(found, picture, explorer=explorer, files=files, text=text))


def write_identification(folder: Folder, found: Identification, *, stem: str, source: str, text: str) -> None:
    """Write the page and its picture, both named after the case file."""
    folder.write(
        f"{stem}.html", page.identification(found, _draw_both(folder, stem, partial(draw_identification, found)), source, text)
    )


def write_replay(folder: Folder, found: Mapping[str, Replay], problem: Problem, *, stem: str, source: str, case: str) -> None:
    """Write the page of a replay and its picture, both with this stem."""
    shown, t_end = replayed.panels(found, problem), float(next(iter(found.values())).times[-1])
    drawn = _draw_both(folder, stem, partial(draw_panels, shown, t_end))
    folder.write(f"{stem}.html", page.replay(found, problem, drawn, source, case))


def _draw(folder: Folder, name: str, drawing: Figure) -> ReportFigure:
    folder.write(f"{name}.png", render(drawing, "png"))
    drawing.set_layout_engine(None)  # the layout of the first rendering is kept
    wide = svg_of(name, drawing)
    folder.write(wide.file, wide.svg)
    return ReportFigure(wide)


def _draw_both(folder: Folder, name: str, figure: Drawn) -> ReportFigure:
    """Write the wide version as PNG and SVG, and the narrow version as SVG."""
    narrow = svg_of(f"{name}{NARROW}", figure(narrow=True))
    folder.write(narrow.file, narrow.svg)
    return replace(_draw(folder, name, figure(narrow=False)), narrow=narrow)
