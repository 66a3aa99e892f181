"""Numbers on logarithmic axes as plain text: Matplotlib would set each as mathematics, a fifth of the time of a picture."""

from __future__ import annotations

import math
import re

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatterSciNotation

from barbalat.pictures.symbols import times_power

POWER = re.compile(r"\$\\mathdefault\{(?P<sign>-?)(?:(?P<mantissa>[\d.]+)\\times)?10\^\{(?P<exponent>-?\d+)\}\}\$")
"""What Matplotlib writes."""


class PlainPowers(LogFormatterSciNotation):
    """Labels where Matplotlib does."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return plain(super().__call__(x, pos))


def plain(text: str) -> str:
    """0.2, 10, 3·10⁻² in place of the same as mathematics; another text as it is."""
    found = POWER.fullmatch(text)
    if found is None:
        return text
    mantissa, exponent = found["mantissa"] or "1", int(found["exponent"])
    return found["sign"] + (f"{float(mantissa) * 10.0**exponent:g}" if abs(exponent) <= 1 else times_power(mantissa, exponent))


def power_of_ten(value: float) -> str:
    """0.1, 1, 10, and 10 with its exponent beyond; for whole powers. Nothing for the zero below the smallest number."""
    if value <= 0:
        return ""
    exponent = round(math.log10(value))
    return f"{10.0**exponent:g}" if abs(exponent) <= 1 else times_power("1", exponent)


def with_plain_powers(figure: Figure) -> None:
    """On all logarithmic axes of a figure that have nothing else."""
    insets = [inset for axes in figure.axes for inset in axes.child_axes if isinstance(inset, Axes)]
    for axes in (*figure.axes, *insets):
        for axis in (axes.xaxis, axes.yaxis):
            major, minor = axis.get_major_formatter(), axis.get_minor_formatter()
            if type(major) is LogFormatterSciNotation:
                axis.set_major_formatter(PlainPowers(labelOnlyBase=major.labelOnlyBase))
            if type(minor) is LogFormatterSciNotation:
                axis.set_minor_formatter(PlainPowers(labelOnlyBase=minor.labelOnlyBase))
