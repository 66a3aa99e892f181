"""Drawn pictures in the form that pages need, and functions that a second process may call to draw them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup
from matplotlib.figure import Figure

from barbalat.pictures.panel_drawing import draw as draw_panels
from barbalat.pictures.panels import Panel
from barbalat.pictures.render import render
from barbalat.report.file_names import NARROW


@dataclass(frozen=True)
class DrawnFile:
    """An SVG and the name of its file."""

    file: str
    svg: str

    def address(self, alone: bool) -> str:
        """The address of the file or, if ``alone``, a data URL with its content. Characters that would end the URL or its
        attribute are escaped."""
        if not alone:
            return self.file
        text = self.svg
        for letter, replaced in (("%", "%25"), ("#", "%23"), ("\n", " "), ("&", "&amp;"), ('"', "'"), ("://", "%3A//")):
            text = text.replace(letter, replaced)
        return Markup("data:image/svg+xml,{}").format(Markup(text))


@dataclass(frozen=True)
class ReportFigure:
    """A drawn figure, and its version for phones if there is one."""

    wide: DrawnFile
    narrow: DrawnFile | None = None


def svg_of(name: str, drawing: Figure) -> DrawnFile:
    """Return the figure as an SVG with this name."""
    return DrawnFile(f"{name}.svg", render(drawing, "svg").decode())


def narrow_panels(name: str, shown: Sequence[Panel], t_end: float) -> DrawnFile:
    """Draw panels for a phone."""
    return svg_of(f"{name}{NARROW}", draw_panels(shown, t_end, narrow=True))
