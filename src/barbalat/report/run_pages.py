"""The pages of ``run`` and ``certify``, whose charts the browser draws from data.

Matplotlib takes longer than most runs, so it draws only pictures that are requested as PNG and SVG.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from barbalat.certificates.certificate import Certificate
from barbalat.certificates.certify import Certified
from barbalat.certificates.picture import MarginLoop, distinct, grouped, responses_of
from barbalat.folders import Folder
from barbalat.pictures.chart_data import panels_data, responses_data
from barbalat.report.diagrams import of_controller
from barbalat.report.file_names import CERTIFICATES, PAGE, PICTURE, diagram_names, loop_names
from barbalat.report.rendering import render
from barbalat.run.results.picture import ends_at, panels
from barbalat.run.results.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_comparison(
    folder: Folder, case: str, results: Sequence[Result], certified: Certified, *, pictures: bool = False
) -> None:
    """Write the page of ``barbalat run`` and, with ``pictures``, its charts and block diagrams as files."""
    shown, t_end = panels(results), ends_at(results)
    drawn = [of_controller(result.controller, result.problem) for result in results]
    diagrams = {
        name: svg for name, svg in zip(diagram_names([one.name for one in results]), drawn, strict=True) if svg is not None
    }
    values = {"results": results, "panels": panels_data(shown, t_end), "diagrams": [*map(Markup, diagrams.values())]}
    folder.write(PAGE, render("comparison.html", {"name": case, **values, **_certified(certified)}))
    if not pictures:
        return
    from barbalat.pictures.panel_drawing import draw

    _draw(folder, PICTURE, draw(shown, t_end))
    for name, svg in diagrams.items():
        folder.write(f"{name}.svg", svg)
    _draw_loops(folder, distinct(certified.certificates))


def write_certificates(folder: Folder, case: str, certified: Certified, document: str, *, pictures: bool = False) -> None:
    """Write the page of ``barbalat certify`` and the JSON document, and, with ``pictures``, the loops as files."""
    folder.write(CERTIFICATES, document)
    folder.write(PAGE, render("certified.html", {"name": case, **_certified(certified)}))
    if pictures:
        _draw_loops(folder, distinct(certified.certificates))


def _certified(certified: Certified) -> dict[str, Any]:
    """Return the values of a template that shows certificates, with the responses of the loops behind their margins."""
    return {"certified": certified, "loops": loops_data(certified.certificates)}


def loops_data(certificates: Mapping[str, Certificate]) -> list[dict[str, Any]]:
    """Return the loops behind the margins of the certificates, in the form that the charts of a page need."""
    return [responses_data(responses_of(some)) for some in grouped(distinct(certificates))]


def _draw_loops(folder: Folder, loops: Sequence[MarginLoop]) -> None:
    """Draw pictures of the loops, each with as many loops as there are colours."""
    from barbalat.pictures.frequency import draw

    groups = grouped(loops)
    for name, some in zip(loop_names(len(groups)), groups, strict=True):
        _draw(folder, name, draw(responses_of(some), ""))


def _draw(folder: Folder, name: str, drawing: Figure) -> None:
    from barbalat.pictures.render import render as rendered

    for kind in ("png", "svg"):
        folder.write(f"{name}.{kind}", rendered(drawing, kind))
