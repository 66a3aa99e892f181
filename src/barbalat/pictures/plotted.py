"""What can be plotted is shown in notebooks by its one line and its plot."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Plotted(ABC):
    """A result with a plot of its own."""

    @abstractmethod
    def plot(self, *, shown: bool = True) -> Figure:
        """Draw a Matplotlib figure; if ``shown``, show it at once, by pyplot where that is in use."""

    def _repr_html_(self) -> str:
        """For notebooks: the line that stands at a prompt, and the plot."""
        from barbalat.pictures.notebook import html_of

        return html_of(self, self.plot(shown=False))
