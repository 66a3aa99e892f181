"""What ``certify`` gives back: the certificates of several controllers, by their names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING

from barbalat.certificates.certificate import Certificate
from barbalat.certificates.picture import TITLE, distinct, figure_of, grouped
from barbalat.certificates.table_1 import Table1, table_1
from barbalat.validate import InputError, Named

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from barbalat.problem.tracking import TrackingProblem
    from barbalat.protocols import Controller
    from barbalat.solvers.simulation import Simulation

CAPTION = "Bode, Nyquist and sensitivity"


class Certificates(Named[Certificate]):
    """Certificates on one problem by their controllers' names: a dictionary that a person can read, and plot."""

    kind = "controller"

    def __init__(
        self,
        found: Mapping[str, Certificate],
        problem: TrackingProblem,
        controllers: Sequence[Controller],
        simulation: Simulation,
    ) -> None:
        super().__init__(found)
        self.problem, self.controllers, self.simulation = problem, controllers, simulation

    def with_changed(self, changed: Mapping[str, Certificate]) -> Certificates:
        """Return a copy with other certificates for some of the controllers."""
        return Certificates({**self, **changed}, self.problem, self.controllers, self.simulation)

    @cached_property
    def table(self) -> Table1:
        """Table 1 of the controllers, each cell checked on the problem."""
        return table_1(self.problem, self.controllers, self)

    def __repr__(self) -> str:
        return f"<Certificates: {'; '.join(f'{name!r} {certificate.in_brief}' for name, certificate in self.items())}>"

    def _repr_html_(self) -> str:
        """For notebooks: five lines for each controller, what was noted, the pictures of the loops."""
        from barbalat.certificates.summary import five, measured
        from barbalat.pictures.notebook import image_of

        rows = []
        for column in self.table.columns:
            certificate = self[column.name]
            rows.append(f'<th scope="rowgroup">{escape(column.name)}</th><th scope="col">{escape(column.scheme)}</th>')
            rows += [
                f'<th scope="row">{escape(one.label)}</th><td>{escape(one.text)}</td>'
                for one in (*five(column, certificate, self.simulation.dt), measured(certificate))
                if one is not None
            ]
        lines = "".join(f"<tr>{row}</tr>" for row in rows)
        notes = "<br>".join(escape(f"{name}: {note}") for name, certificate in self.items() for note in certificate.notes)
        pictures = (
            image_of(figure_of(loops, TITLE, shown=False), f"{CAPTION}: {'; '.join(one.name for one in loops)}")
            for loops in grouped(distinct(self))
        )
        return f"<table>{lines}</table><small>{notes}</small><br>{''.join(pictures)}"

    def plot(self, *, narrow: bool = False) -> Figure:
        """The loops of all, each once, as ``Certificate.plot`` shows those of one; ``narrow`` for a phone or a column."""
        loops = distinct(self)
        if not loops:
            raise InputError("these certificates have no linear loop with margins to plot; their findings say why")
        return figure_of(loops, TITLE, narrow=narrow)
