"""``plot``: runs of one problem side by side."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from barbalat.run.result import Result
from barbalat.validate import InputError, show

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot(
    results: Result | Mapping[str, Result] | Iterable[Result],
    *,
    panels: str | Iterable[str] | None = None,
    axes: Axes | Iterable[Axes] | None = None,
    narrow: bool = False,
) -> Figure:
    """Runs of one problem side by side, as a Matplotlib figure: what ``simulate`` gave back, or results of several calls.

    panels  names of those that are drawn: motion, x_1 ... or y, largest error, control, error, estimates, or a controller's or a
            state's own name; all by default
    axes    Matplotlib axes to draw into, one for each of the panels; a new figure by default
    narrow  one panel below the other, for a phone or a column of a page

    Raises InputError for a panel that there is not, and for more or fewer axes than panels.
    """
    from barbalat.run.picture import figure_of

    return figure_of(_listed(results), names=panels, axes=axes, narrow=narrow, shown=True)


def _listed(results: Result | Mapping[str, Result] | Iterable[Result]) -> list[Result]:
    given = [results] if isinstance(results, Result) else results
    found = list(given.values() if isinstance(given, Mapping) else given)
    for one in found:
        if not isinstance(one, Result):
            raise InputError(f"plot takes results of simulate, got {show(one)}")
    if not found:
        raise InputError("plot needs at least one result, got none")
    return found
