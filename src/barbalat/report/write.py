"""What the commands leave on disk: pictures, pages, JSON, trajectories."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from barbalat.certificates.overview import Certified
from barbalat.claims.claim import Claim, Map, PaperFigure
from barbalat.controllers.output.l1 import L1Output
from barbalat.problem.output_feedback import OutputProblem
from barbalat.report import charts, diagrams, maps, page, plots, tradeoff
from barbalat.report.files import write
from barbalat.run.result import Result
from barbalat.study.tradeoff import TradeOff


def as_json(document: dict[str, Any]) -> str:
    """JSON text; a NaN or an infinity in it would be an error of ours and is refused."""
    return json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False)


def reproduction_document(
    figures: Sequence[PaperFigure], claims: Sequence[Claim], certified: Certified, seconds: dict[str, float]
) -> dict[str, Any]:
    """The contract's document of ``reproduce --json``."""
    return {
        "figures": {figure.key: figure.as_json() for figure in figures},
        "claims": [claim.as_json() for claim in claims],
        "seconds": seconds,
        **certified.as_json(),
    }


def run_document(case: str, results: Sequence[Result], certified: Certified | None) -> dict[str, Any]:
    """The contract's document of ``run --json``; numerics, and certificates where they were made, stand beside its keys."""
    simulation = results[0].simulation
    return {
        "case": case,
        "simulation": {"t_end": simulation.t_end, "dt": simulation.dt, "solver": simulation.solver.name},
        "controllers": {r.name: run_block(r) for r in results},
        **({} if certified is None else certified.as_json()),
    }


def run_block(result: Result) -> dict[str, Any]:
    """The contract's block for a controller, and the numerics beside its keys."""
    found = result.stiffness
    check = None if result.check is None else result.check.as_json()
    lost = {} if result.lost is None else {"lost_order": result.lost.as_json()}
    return {
        **result.figures,
        "h_lambda_max": found.h_lambda_max,
        "numerically_unstable_at": found.unstable_from,
        "finer_step": check,
        **lost,
        "adapting": None if result.adapting is None else result.adapting.as_json(),
    }


def draw_reproduction(folder: Path, figures: Sequence[PaperFigure]) -> dict[str, page.Picture]:
    """Draw every figure into the folder."""
    pictures = {}
    for figure in figures:
        drawing = plots.comparison(figure.shown) if len(figure.shown) > 1 else plots.error_and_estimates(figure.shown[0])
        pictures[figure.key] = _draw(folder, f"figure-{figure.key}", drawing)
    return pictures


def draw_maps(folder: Path, claims: Sequence[Claim]) -> dict[str, page.Picture]:
    """Draw every map and chart of the claims into the folder; pictures by their keys."""
    return {
        shown.key: _draw(folder, f"map-{shown.key}", maps.draw(shown) if isinstance(shown, Map) else charts.draw(shown))
        for claim in claims
        for shown in claim.maps
    }


def write_comparison(folder: Path, case: str, results: Sequence[Result], certified: Certified) -> list[Path]:
    """The picture of the runs, a block diagram for each L1 output-feedback controller, and the page."""
    picture = _draw(folder, "comparison", plots.comparison(results))
    drawn_diagrams = [_diagram(folder, r) for r in results if isinstance(r.controller, L1Output)]
    page_file = write(folder / "report.html", page.comparison(case, results, certified, picture, drawn_diagrams))
    drawn = [folder / f"{shown.name}.{kind}" for shown in (picture, *drawn_diagrams) for kind in ("png", "svg")]
    return [*drawn, page_file]


def _diagram(folder: Path, result: Result) -> page.Picture:
    assert isinstance(result.controller, L1Output) and isinstance(result.problem, OutputProblem)
    drawing = diagrams.l1_output(result.controller, result.problem.plant)
    return _draw(folder, f"diagram-{_file_name(result.name)}", drawing)


def write_tradeoff(folder: Path, found: TradeOff) -> Path:
    """Picture and page of a trade-off."""
    picture = _draw(folder, "tradeoff", tradeoff.draw(found))
    return write(folder / "report.html", page.trade_off(found, picture))


def write_trajectories(folder: Path, results: Sequence[Result]) -> list[Path]:
    """One CSV for each controller, the recorded instants as rows."""
    written = []
    for i, result in enumerate(results, start=1):
        buffer = io.StringIO()
        columns = {"t": result.t} | result.columns()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
        written.append(write(folder / f"{i}-{_file_name(result.name)}.csv", buffer.getvalue()))
    return written


def _draw(folder: Path, name: str, drawing: Figure) -> page.Picture:
    png = plots.render(drawing, "png")
    drawing.set_layout_engine("none")  # what the first rendering has laid out stays where it is
    write(folder / f"{name}.png", png)
    write(folder / f"{name}.svg", plots.render(drawing, "svg"))
    return page.Picture(name, png)


def _file_name(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-").lower() or "controller"
