"""What ``simulate`` gives back: the runs of several controllers, by their names."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from barbalat.run.outcome import outcome_in_brief
from barbalat.run.result import Result
from barbalat.validate import Named

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class Results(Named[Result]):
    """Runs of one problem by their controllers' names: a dictionary that a person can read, and plot."""

    kind = "controller"

    def __repr__(self) -> str:
        return f"<Results: {'; '.join(f'{name!r} {outcome_in_brief(result)}' for name, result in self.items())}>"

    def _repr_html_(self) -> str:
        """For notebooks: the figures as a table, what deserves a second look, and the plot."""
        from barbalat.run.notebook import html_of

        return html_of(list(self.values()))

    def plot(
        self, *, panels: str | Iterable[str] | None = None, axes: Axes | Iterable[Axes] | None = None, narrow: bool = False
    ) -> Figure:
        """All runs side by side, as a Matplotlib figure; ``barbalat.results.plot`` says what may be chosen."""
        from barbalat.run.plot import plot

        return plot(self, panels=panels, axes=axes, narrow=narrow)
