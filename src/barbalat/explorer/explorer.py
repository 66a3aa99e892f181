"""``explore(problem, controllers, simulation)``: a page that simulates, as an object that notebooks show."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

from barbalat import validate
from barbalat.cases.build import Case
from barbalat.explorer.certified import section
from barbalat.explorer.describe import Described
from barbalat.explorer.lessons import Lesson
from barbalat.explorer.page import html
from barbalat.explorer.source import ObjectSource, Source
from barbalat.loop.binding import numbered
from barbalat.open_numbers.path import FieldPath
from barbalat.papers.claim import Claim
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.solvers.registry import solver_of
from barbalat.solvers.simulation import Simulation

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
    return Explorer(ObjectSource(Case(problem, tuple(numbered(controllers)), simulation)))
