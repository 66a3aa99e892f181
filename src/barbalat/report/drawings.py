"""Drawn pictures, as pages hold them, and those that a second process may draw: few imports, for it starts when a run does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup
from matplotlib.figure import Figure

from barbalat.certificates.picture import MarginLoop, grouped, responses_of
from barbalat.pictures.frequency import draw as draw_responses
from barbalat.pictures.panel_drawing import draw as draw_panels
from barbalat.pictures.panels import Panel
from barbalat.pictures.render import render
from barbalat.report.file_names import NARROW, loop_names


@dataclass(frozen=True)
class DrawnFile:
    """An SVG and the file that it is in."""

    file: str
    svg: str

    def address(self, alone: bool) -> str:
        """Its file's, or one that holds all of it; what would end that or its attribute is replaced."""
        if not alone:
            return self.file
        text = self.svg
        for letter, replaced in (("%", "%25"), ("#", "%23"), ("\n", " "), ("&", "&amp;"), ('"', "'"), ("://", "%3A//")):
            text = text.replace(letter, replaced)
        return Markup("data:image/svg+xml,{}").format(Markup(text))


@dataclass(frozen=True)
class ReportFigure:
    """A drawn figure, and how it is drawn for phones where that differs."""

    wide: DrawnFile
    narrow: DrawnFile | None = None


def svg_of(name: str, drawing: Figure) -> DrawnFile:
    """A figure as an SVG of that name."""
    return DrawnFile(f"{name}.svg", render(drawing, "svg").decode())


def narrow_panels(name: str, shown: Sequence[Panel], t_end: float) -> DrawnFile:
    """Panels for a phone."""
    return svg_of(f"{name}{NARROW}", draw_panels(shown, t_end, narrow=True))


def pictures_of_loops(found: Sequence[MarginLoop]) -> list[ReportFigure]:
    """So many loops in a picture as there are colours."""
    groups = grouped(found)
    return [_loops(name, group) for name, group in zip(loop_names(len(groups)), groups, strict=True)]


def _loops(name: str, loops: Sequence[MarginLoop]) -> ReportFigure:
    responses = responses_of(loops)
    wide, narrow = (draw_responses(responses, "", narrow=narrow) for narrow in (False, True))
    return ReportFigure(svg_of(name, wide), svg_of(f"{name}{NARROW}", narrow))
