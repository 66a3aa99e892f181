"""The certificates of several controllers, by their names, and Table 1: the guarantees of each scheme on the case.

The paper's table compares the standard MRAC with L1-AC; the table is missing from the available text. docs/table-1.md gives each
statement with its source. A scheme is added by one file in ``schemes/``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, cast

from barbalat.certificates.assumptions import unmet_by
from barbalat.certificates.cells import PROPERTIES, Column, nothing
from barbalat.certificates.certificate import Certificate, reason
from barbalat.certificates.picture import TITLE, distinct, figure_of, grouped
from barbalat.certificates.schemes import SchemeFile, observed, scheme_file, unregistered
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.validate import InputError, Named

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from barbalat.problem.tracking import TrackingProblem
    from barbalat.protocols import Controller
    from barbalat.solvers.simulation import Simulation


def file_of(problem: TrackingProblem, controller: Controller) -> SchemeFile:
    """The module that certifies a controller on a problem: the file of its scheme, or a general file if there is an observer or
    the scheme is unknown."""
    if problem.fixed_observer is not None:
        return cast("SchemeFile", observed)
    return scheme_file(controller) or cast("SchemeFile", unregistered)


def column_of(problem: TrackingProblem, controller: Controller, certificate: Certificate) -> Column:
    """A controller's column; if its computation fails, each cell says so."""
    try:
        scheme, cells = file_of(problem, controller).column(problem, controller, certificate)
        return Column(controller.name, scheme, Named.of("cell", cells))
    except Exception as error:  # noqa: BLE001 (only this column fails; the others are still shown)
        return Column(controller.name, type(controller).__name__, {key: nothing(key, reason(error)) for key in PROPERTIES})


@dataclass(frozen=True)
class Table1:
    """Table 1 of a case. Each cell is checked on the case: if the case violates the assumptions of a cell, the cell says so
    instead."""

    columns: tuple[Column, ...]

    def as_json(self) -> dict[str, Any]:
        """The block ``table_1`` of the documents that ``certify --json`` prints."""
        return {"properties": PROPERTIES, "columns": [column.as_json() for column in self.columns]}


def table_1(
    problem: TrackingProblem,
    controllers: Sequence[Controller],
    certificates: Mapping[str, Certificate],
    of_design: Mapping[str, Collection[str]] = MappingProxyType({}),
) -> Table1:
    """Table 1 with one column for each controller; each cell is checked on the problem.

    ``of_design`` gives, by controller, the keys of cells that don't hold for the simulated plant.
    """
    columns = (column_of(problem, controller, certificates[controller.name]) for controller in controllers)
    found = tuple(column.with_design(of_design.get(column.name, ())) for column in columns)
    return Table1(tuple(column.given(unmet_by(problem)) for column in found))


CAPTION = "Bode, Nyquist and sensitivity"


class Certificates(Named[Certificate]):
    """Certificates for one problem by the names of the controllers: a dictionary that is readable at a prompt and can be
    plotted."""

    kind = "controller"

    def __init__(
        self,
        found: Mapping[str, Certificate],
        problem: TrackingProblem,
        controllers: Sequence[Controller],
        simulation: Simulation,
        further_blocks: Mapping[str, Any] = MappingProxyType({}),
        of_design: Mapping[str, Collection[str]] = MappingProxyType({}),
        plain: Mapping[str, Certificate] | None = None,
    ) -> None:
        super().__init__(found)
        self.plain = found if plain is None else plain  # before guarantees are marked as holding for the design only
        self.problem, self.controllers, self.simulation, self.further_blocks = (
            problem,
            controllers,
            simulation,
            dict(further_blocks),
        )
        self.of_design = of_design

    def with_changed(self, changed: Mapping[str, Certificate]) -> Certificates:
        """Return a copy with different certificates for some of the controllers."""
        of = self.problem, self.controllers, self.simulation, self.further_blocks, self.of_design, self.plain
        return Certificates({**self, **changed}, *of)

    @cached_property
    def table(self) -> Table1:
        """Table 1 of the controllers; each cell is checked on the problem."""
        return table_1(self.problem, self.controllers, self.plain, self.of_design)

    def __repr__(self) -> str:
        return f"<Certificates: {'; '.join(f'{name!r} {certificate.in_brief}' for name, certificate in self.items())}>"

    def _repr_html_(self) -> str:
        """For notebooks: five lines for each controller, the notes, the plots of the loops."""
        from barbalat.certificates.summary import lines
        from barbalat.pictures.plotted import image_of

        rows = []
        for column in self.table.columns:
            certificate = self[column.name]
            rows.append(f'<th scope="rowgroup">{escape(column.name)}</th><th scope="col">{escape(column.scheme)}</th>')
            rows += [
                f'<th scope="row">{escape(one.label)}</th><td>{escape(one.text)}</td>'
                for one in lines(column, certificate, self.simulation.dt)
            ]
        shown = "".join(f"<tr>{row}</tr>" for row in rows)
        notes = "<br>".join(escape(f"{name}: {note}") for name, certificate in self.items() for note in certificate.notes)
        pictures = (
            image_of(figure_of(loops, TITLE, shown=False), f"{CAPTION}: {'; '.join(one.name for one in loops)}")
            for loops in grouped(distinct(self))
        )
        return f"<table>{shown}</table><small>{notes}</small><br>{''.join(pictures)}"

    def plot(self, *, narrow: bool = False) -> Figure:
        """Plot all distinct loops, in the form of ``Certificate.plot``; ``narrow`` is for a phone or a column."""
        loops = distinct(self)
        if not loops:
            raise InputError("these certificates have no linear loop with margins to plot; their findings give the reason")
        return figure_of(loops, TITLE, narrow=narrow)
