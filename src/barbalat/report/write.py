"""What the commands leave on disk: pictures, pages, JSON, trajectories."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from barbalat.certificates.overview import Certified
from barbalat.certificates.picture import MarginLoop
from barbalat.certificates.picture import figure_of as loops_of
from barbalat.claims.claim import Claim, Map, PaperFigure
from barbalat.controllers.output.l1 import L1Output
from barbalat.pictures.panels import text_of
from barbalat.pictures.render import render
from barbalat.problem.output_feedback import OutputProblem
from barbalat.report import charts, diagrams, maps, page
from barbalat.report.files import Folder
from barbalat.run.picture import figure_of
from barbalat.run.result import Result
from barbalat.study.tradeoff import TradeOff
from barbalat.study.tradeoff_picture import draw as draw_trade_off

RUN, CERTIFICATES, PICTURE = "run.json", "certify.json", "comparison"
"""Names of files; of the picture without its two suffixes."""
NARROW = "-narrow"
"""After the name of a picture for a phone."""
MOST_NUMBERS = 44_000
"""In all CSVs of a folder: some 450 kB. Results in Python have all that was recorded."""
LONGEST_NAME = 80
"""Characters of a controller's name in a file's; file systems take 255 bytes, and people read fewer."""


def draw_reproduction(folder: Folder, figures: Sequence[PaperFigure]) -> dict[str, page.Picture]:
    """Draw every figure into the folder, but for those for phones."""
    pictures = {}
    for figure in figures:
        name = f"figure-{figure.key}"
        pictures[figure.key] = replace(_draw(folder, name, figure_of(figure.shown)), narrow=f"{name}{NARROW}")
    return pictures


def narrow_pictures(figures: Sequence[PaperFigure]) -> dict[str, bytes]:
    """The files of the figures for phones, which another process may draw meanwhile."""
    return {f"figure-{figure.key}{NARROW}.svg": _narrow(figure.shown) for figure in figures}


def draw_maps(folder: Folder, claims: Sequence[Claim]) -> dict[str, page.Picture]:
    """Draw every map and chart of the claims into the folder; pictures by their keys."""
    return {
        shown.key: _draw(folder, f"map-{shown.key}", maps.draw(shown) if isinstance(shown, Map) else charts.draw(shown))
        for claim in claims
        for shown in claim.maps
    }


def write_comparison(folder: Folder, case: str, results: Sequence[Result], certified: Certified) -> None:
    """The picture of the runs, a block diagram for each L1 output-feedback controller, and the page."""
    picture = _draw_runs(folder, PICTURE, results)
    names = _own_names("diagram", [result.name for result in results])
    drawn = [_diagram(folder, *pair) for pair in zip(names, results, strict=True) if isinstance(pair[1].controller, L1Output)]
    folder.write(page.PAGE, page.comparison(case, results, certified, picture, drawn))


def write_certificates(folder: Folder, case: str, certified: Certified, document: str) -> None:
    """The picture of each controller's loops whose margins are given, the page, the JSON document."""
    names = _own_names("loops", list(certified.certificates))
    pictures = {
        name: _draw_loops(folder, file, name, certificate.loops)
        for file, (name, certificate) in zip(names, certified.certificates.items(), strict=True)
        if certificate.loops
    }
    folder.write(CERTIFICATES, document)
    folder.write(page.PAGE, page.certificates(case, certified, pictures))


def _draw_loops(folder: Folder, file: str, name: str, loops: Sequence[MarginLoop]) -> page.Picture:
    title, narrow = f"{text_of(name)}: loops broken at the plant's input", f"{file}{NARROW}"
    wide = _draw(folder, file, loops_of(loops, title, shown=False))
    folder.write(f"{narrow}.svg", render(loops_of(loops, title, narrow=True, shown=False), "svg"))
    return replace(wide, narrow=narrow)


def _diagram(folder: Folder, name: str, result: Result) -> page.Picture:
    assert isinstance(result.controller, L1Output) and isinstance(result.problem, OutputProblem)
    return _draw(folder, name, diagrams.l1_output(result.controller, result.problem.plant))


def files_of_run(folder: Path) -> set[str]:
    """What ``barbalat run`` may have left in a folder, by the ``run.json`` that lies there; nothing where none does."""
    try:
        names = [str(name) for name in json.loads((folder / RUN).read_bytes())["controllers"]]
    except (OSError, ValueError, LookupError, TypeError):
        return set()
    drawn = {f"{name}.{kind}" for name in (PICTURE, *_own_names("diagram", names)) for kind in ("png", "svg")}
    drawn.add(f"{PICTURE}{NARROW}.svg")
    return {RUN, page.PAGE, *_table_names(names)} | drawn


def write_tradeoff(folder: Folder, found: TradeOff) -> None:
    """Picture and page of a trade-off."""
    picture = _draw(folder, "tradeoff", draw_trade_off(found))
    folder.write(page.PAGE, page.trade_off(found, picture))


def write_trajectories(folder: Folder, results: Sequence[Result], *, whole: bool = False) -> None:
    """One CSV for each controller, the recorded instants as rows, or every second, third, ... where these were too many.

    With ``whole`` every recorded instant.
    """
    for name, result in zip(_table_names([result.name for result in results]), results, strict=True):
        buffer = io.StringIO()
        columns = {"t": result.t} | result.columns()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(columns)
        every = 1 if whole else max(math.ceil(len(result.t) * len(columns) * len(results) / MOST_NUMBERS), 1)
        rows = np.unique([*range(0, len(result.t), every), len(result.t) - 1])
        numbers = np.column_stack(list(columns.values()))[rows]
        writer.writerows(numbers.tolist())
        folder.write(name, buffer.getvalue())


def _draw_runs(folder: Folder, name: str, results: Sequence[Result]) -> page.Picture:
    """The picture of runs as it is on a page, and as it is on a phone."""
    wide = _draw(folder, name, figure_of(results))
    narrow = f"{name}{NARROW}"
    folder.write(f"{narrow}.svg", _narrow(results))
    return replace(wide, narrow=narrow)


def _narrow(results: Sequence[Result]) -> bytes:
    return render(figure_of(results, narrow=True), "svg")


def _draw(folder: Folder, name: str, drawing: Figure) -> page.Picture:
    folder.write(f"{name}.png", render(drawing, "png"))
    drawing.set_layout_engine("none")  # what the first rendering has laid out stays where it is
    folder.write(f"{name}.svg", render(drawing, "svg"))
    return page.Picture(name)


def _table_names(names: Sequence[str]) -> list[str]:
    """Of the controllers' CSVs; the number makes them different."""
    return [f"{i}-{_file_name(name)}.csv" for i, name in enumerate(names, start=1)]


def _own_names(kind: str, names: Sequence[str]) -> list[str]:
    """Of each controller's picture of a kind."""
    chosen: list[str] = []
    for name in names:
        plain = f"{kind}-{_file_name(name)}"
        numbered = (f"{plain}-{i}" for i in range(2, len(names) + 1))
        chosen.append(next(new for new in (plain, *numbered) if new not in chosen))
    return chosen


def _file_name(name: str) -> str:
    """What of a name every file system takes."""
    return re.sub(r"[^A-Za-z0-9]+", "-", name)[:LONGEST_NAME].strip("-").lower() or "controller"
