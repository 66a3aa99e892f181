"""``explore(problem, controllers, simulation)``: a page that simulates, as an object that notebooks show."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

import barbalat
from barbalat import validate
from barbalat.cases.build import Case
from barbalat.certificates.certify import certified_case
from barbalat.certificates.rows import CertificateRow
from barbalat.explorer.describe import Described
from barbalat.explorer.lessons import Lesson
from barbalat.explorer.source import ObjectSource, Source
from barbalat.loop.binding import numbered
from barbalat.open_numbers.path import FieldPath
from barbalat.papers.claim import Claim
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.solvers.registry import solver_of
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError

FRAME_HEIGHT = 900
"""Of a page in a notebook's cell, in CSS pixels."""


@dataclass(frozen=True, eq=False)
class PageContents:
    """A page's data and the HTML of its certificates; ``names`` are its controllers'."""

    data: dict[str, Any]
    certificates: str
    names: tuple[str, ...]
    lessons: tuple[Lesson, ...]

    def page(self, claims: Sequence[Claim]) -> str:
        """The whole page, with the verdicts on these claims; InputError where it would be too large."""
        lessons = [lesson.as_data(self.names, claims) for lesson in self.lessons]
        return html(self.data | {"lessons": lessons}, self.certificates)


@dataclass(frozen=True, eq=False, repr=False)
class Explorer:
    """A page with a slider for each number of a case; ``html`` is the whole of it, one file that asks for nothing elsewhere."""

    source: Source
    lessons: tuple[Lesson, ...] = ()

    @cached_property
    def html(self) -> str:
        """The page; InputError where the case can't be simulated in one."""
        return self.contents.page(())

    @cached_property
    def contents(self) -> PageContents:
        """All that is on the page but for the verdicts on claims that its lessons name."""
        described = Described.of(self.source)
        names = tuple(controller.name for controller in described.case.controllers)
        return PageContents(described.as_data(), section(described.case), names, self.lessons)

    def save(self, path: str | Path) -> Path:
        """Write it to a file."""
        place = Path(path)
        place.write_text(self.html, encoding="utf-8")
        return place

    def at(
        self, numbers: Mapping[str, float], *, projection: Mapping[int, bool] | None = None, solver: str | None = None
    ) -> Case:
        """The case with a page's numbers, as *copy as Python* writes them; InputError for what the page can't have."""
        toggled = [i for i, on in (projection or {}).items() if on != self.source.projected(i)]
        case = self.source.at({FieldPath.parse(path): value for path, value in numbers.items()}, toggled)
        if solver is None:
            return case
        return replace(case, simulation=replace(case.simulation, solver=solver_of("solver", solver)))

    def __repr__(self) -> str:
        return f"<Explorer of {self.source.at({}).name!r}: {len(self.html) / 1e3:.0f} kB; save(path) writes it>"

    def _repr_html_(self) -> str:
        frame = f'width="100%" height="{FRAME_HEIGHT}" style="border:0" sandbox="allow-scripts allow-modals"'
        return f'<iframe title="explorer" {frame} srcdoc="{escape(self.html)}"></iframe>'


def explore(problem: TrackingProblem, controllers: Controller | Iterable[Controller], simulation: Simulation) -> Explorer:
    """A page that simulates these controllers on the problem, with a slider for each number.

    Runs in it have no fused multiply-adds: ``Simulation(fused=False)`` has their bits.
    """
    validate.instance("problem", problem, TrackingProblem)
    validate.instance("simulation", simulation, Simulation)
    simulation.require_steps("a page that simulates")
    return Explorer(ObjectSource(Case(problem, tuple(numbered(controllers)), simulation)))


TABLE_HEAD = "<tr>" + "".join(f'<th scope="col">{name}</th>' for name in ("quantity", "value", "kind", "meaning")) + "</tr>"


def section(case: Case) -> str:
    """HTML that says what it belongs to; folded, one part for each controller."""
    found = certified_case(case.problem, case.controllers, case.simulation).certificates
    parts = [
        f'<details><summary>{escape(name)}</summary><div class="wide" tabindex="0" role="region" '
        f'aria-label="Certificates of {escape(name)}"><table class="figures"><thead>{TABLE_HEAD}</thead><tbody>'
        f"{''.join(map(_row, certificate.rows))}</tbody></table></div></details>"
        for name, certificate in found.items()
    ]
    note = (
        "They belong to the case as it is given, whatever the sliders say; for a copied case file barbalat certify has its own."
    )
    return f'<h2>Certificates of the case</h2><p class="note">{note}</p>{"".join(parts)}'


def _row(row: CertificateRow) -> str:
    cells = "".join(f"<td>{escape(text)}</td>" for text in (row.value, row.kind, row.meaning))
    return f'<tr><th scope="row">{escape(row.quantity)}</th>{cells}</tr>'


LARGEST_PAGE = 1_500_000
"""Bytes: what a mail takes and a phone opens at once."""
WORKER_FILES = (
    "bytes.js",
    "grid.js",
    "kernel.js",
    "noise.js",
    "figures.js",
    "spectrum.js",
    "stability.js",
    "judge.js",
    "impulse.js",
    "worker.js",
)
PAGE_FILES = (
    "bytes.js", "setting.js", "lessons.js", "address.js", "copies.js", "panels.js", "zoom.js", "charts.js", "table.js",
    "controls.js", "page.js",
)  # fmt: skip
"""Scripts in the order in which one needs the other."""


def html(data: dict[str, Any], certificates: str) -> str:
    """The whole page; InputError where it would be too large to be sent."""
    parts = {
        "TITLE": escape(str(data["case"])),
        "VERSION": escape(barbalat.__version__),
        "STYLE": _text("uplot/uPlot.min.css") + _text("page.css"),
        "UPLOT": _text("uplot/uPlot.iife.min.js"),
        "LICENCE": escape(_text("uplot/LICENSE").strip()),
        "DATA": as_script_data(data),
        "WORKER": as_script_data("\n".join(map(_script, WORKER_FILES))),
        "PAGE": "\n".join(map(_script, PAGE_FILES)),
        "CERTIFICATES": certificates,
    }
    page = re.sub(r"\{\{([A-Z]+)\}\}", lambda found: parts[found[1]], _text("explore.html"))
    if (size := len(page.encode())) > LARGEST_PAGE:
        raise InputError(f"the page would have {size} bytes, more than {LARGEST_PAGE}: explore fewer controllers at a time")
    return page


def as_script_data(part: Any) -> str:
    """JSON that no text in it can end: a script element knows no escapes but those of JSON."""
    return json.dumps(part, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")


def _text(name: str) -> str:
    return (resources.files("barbalat.explorer") / "templates" / name).read_text("utf-8")


def _script(name: str) -> str:
    """A module's text without its imports and exports: one file holds them all, from which modules can't be imported."""
    text = re.sub(r"^import .*;$", "", _text(name), flags=re.MULTILINE)
    return re.sub(r"^export ", "", text, flags=re.MULTILINE)
