"""``explore(problem, controllers, simulation)`` returns a page that simulates, as an object that notebooks show."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from importlib import resources
from importlib.resources.abc import Traversable
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
from barbalat.pictures.scripts import CHARTS, UPLOT, UPLOT_LICENCE, UPLOT_STYLE, as_script_data, script_of
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.solvers.registry import solver_of
from barbalat.solvers.simulation import Simulation
from barbalat.study.fixed_steps import fixed_steps
from barbalat.validate import InputError

FRAME_HEIGHT = 900
"""Height of a page in a notebook cell, in CSS pixels."""


@dataclass(frozen=True, eq=False)
class PageContents:
    """The data of a page, the HTML of its certificates, and the ``names`` of its controllers."""

    data: dict[str, Any]
    certificates: str
    names: tuple[str, ...]
    lessons: tuple[Lesson, ...]

    def page(self, claims: Sequence[Claim]) -> str:
        """Return the whole page, with the findings of these claims. Raises InputError if it would be too large."""
        lessons = [lesson.as_data(self.names, claims) for lesson in self.lessons]
        return html(self.data | {"lessons": lessons}, self.certificates)


@dataclass(frozen=True, eq=False, repr=False)
class Explorer:
    """A page with a slider for each number of a case. ``html`` is the complete page, one file that needs no network."""

    source: Source
    lessons: tuple[Lesson, ...] = ()

    @cached_property
    def html(self) -> str:
        """The page. Raises InputError if a page cannot simulate the case."""
        return self.contents.page(())

    @cached_property
    def contents(self) -> PageContents:
        """The content of the page without the findings of the claims that its lessons name."""
        described = Described.of(self.source)
        names = tuple(controller.name for controller in described.case.controllers)
        return PageContents(described.as_data(), section(described.case), names, self.lessons)

    def save(self, path: str | Path) -> Path:
        """Write the page to a file."""
        place = Path(path)
        place.write_text(self.html, encoding="utf-8")
        return place

    def at(
        self, numbers: Mapping[str, float], *, projection: Mapping[int, bool] | None = None, solver: str | None = None
    ) -> Case:
        """Return the case with a page's numbers, as *copy as Python* writes them. Raises InputError for numbers that the page
        cannot have."""
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
    """Return a page that simulates these controllers on the problem, with a slider for each number.

    The runs of the page use no fused multiply-adds; ``Simulation(fused=False)`` gives bit-identical results. If the simulation
    has a tolerance, the runs take the longest fixed step at which the errors and controls of the given controllers are within the
    tolerance.
    """
    validate.instance("problem", problem, TrackingProblem)
    validate.instance("simulation", simulation, Simulation)
    given = tuple(numbered(controllers))
    steps = fixed_steps(problem, given, simulation)
    return Explorer(ObjectSource(Case(problem, given, steps.simulation)))


TABLE_HEAD = "<tr>" + "".join(f'<th scope="col">{name}</th>' for name in ("quantity", "value", "kind", "meaning")) + "</tr>"


def section(case: Case) -> str:
    """Return the certificates as HTML: a note on the case to which they belong, and a collapsed section for each controller."""
    found = certified_case(case.problem, case.controllers, case.simulation).certificates
    parts = [
        f'<details><summary>{escape(name)}</summary><div class="wide" tabindex="0" role="region" '
        f'aria-label="Certificates of {escape(name)}"><table class="figures"><thead>{TABLE_HEAD}</thead><tbody>'
        f"{''.join(map(_row, certificate.rows))}</tbody></table></div></details>"
        for name, certificate in found.items()
    ]
    note = (
        "They are the certificates of the case itself and do not depend on the sliders. For a copied case file, use barbalat "
        "certify."
    )
    return f'<h2>Certificates of the case</h2><p class="note">{note}</p>{"".join(parts)}'


def _row(row: CertificateRow) -> str:
    cells = "".join(f"<td>{escape(text)}</td>" for text in (row.value, row.kind, row.meaning))
    return f'<tr><th scope="row">{escape(row.quantity)}</th>{cells}</tr>'


LARGEST_PAGE = 1_500_000
"""Largest size of a page in bytes. Such a page can be mailed and opened on a phone."""
WORKER_FILES = (
    "bytes.js",
    "grid.js",
    "faults.js",
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
    "bytes.js",
    "setting.js",
    "lessons.js",
    "address.js",
    "copies.js",
    "panels.js",
    "table.js",
    "controls.js",
    "page.js",
)
"""Scripts in the order of their dependencies. The scripts of the charts precede them."""


def html(data: dict[str, Any], certificates: str) -> str:
    """Return the whole page. Raises InputError if it would be too large to be sent."""
    parts = {
        "TITLE": escape(str(data["case"])),
        "VERSION": escape(barbalat.__version__),
        "STYLE": UPLOT_STYLE.read_text("utf-8") + _template("page.css").read_text("utf-8"),
        "UPLOT": UPLOT.read_text("utf-8"),
        "LICENCE": escape(UPLOT_LICENCE.read_text("utf-8").strip()),
        "DATA": as_script_data(data),
        "WORKER": as_script_data("\n".join(script_of(_template(name)) for name in WORKER_FILES)),
        "PAGE": "\n".join(map(script_of, [*CHARTS, *map(_template, PAGE_FILES)])),
        "CERTIFICATES": certificates,
    }
    page = re.sub(r"\{\{([A-Z]+)\}\}", lambda found: parts[found[1]], _template("explore.html").read_text("utf-8"))
    if (size := len(page.encode())) > LARGEST_PAGE:
        raise InputError(f"the page would have {size} bytes, more than {LARGEST_PAGE}: explore fewer controllers at a time")
    return page


def _template(name: str) -> Traversable:
    return resources.files("barbalat.explorer") / "templates" / name
