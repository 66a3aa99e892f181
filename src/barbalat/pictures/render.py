"""Writes a figure as a PNG, or as an SVG that adapts to the reader's light or dark background."""

from __future__ import annotations

import colorsys
import io
import math
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatterSciNotation

from barbalat.pictures.palette import COLOURS, ON_DARK
from barbalat.pictures.symbols import times_power
from barbalat.pictures.theme import DARK_GROUND, DARK_INK, DARK_QUIET_INK, GROUND, INK, QUIET_INK, Theme

if TYPE_CHECKING:
    from PIL import Image

PIXELS_PER_INCH = 110
"""Resolution of a PNG: 1100 pixels for a page's width."""
PALETTE_ROWS, EDGE_SHADES = 24, 4
"""Number of pixels to which a picture is reduced while its colours are chosen, and number of shades of each colour in it. With
fewer than 20 rows, purple became grey."""
PNG_COLOURS = 128
"""Size of a PNG's palette. It reduces the file to one third, and the smoothed edges of lines look the same."""


def render(figure: Figure, kind: str) -> bytes:
    """Return the figure as "png" or "svg". The same input gives the same bytes."""
    import matplotlib as mpl

    buffer = io.BytesIO()
    with_plain_powers(figure)
    with warnings.catch_warnings(), _laid_out(figure):
        warnings.filterwarnings("ignore", message=r"Glyph \d+")  # if the font lacks a script, names become boxes
        if kind == "svg":
            with mpl.rc_context({"svg.hashsalt": "barbalat", "svg.fonttype": "path", "path.simplify_threshold": 0.25}):
                figure.savefig(buffer, format="svg", metadata={"Date": None})
            return adaptive(buffer.getvalue().decode()).encode()
        figure.savefig(buffer, format="png", dpi=PIXELS_PER_INCH, pil_kwargs={"compress_level": 0})
    return _packed(buffer)


@contextmanager
def _laid_out(figure: Figure) -> Iterator[None]:
    """Compute the figure's layout once. Otherwise Matplotlib would draw the whole figure for the layout, and then once more."""
    engine = figure.get_layout_engine()
    if engine is None:
        yield
        return
    engine.execute(figure)
    figure.set_layout_engine(None)  # "none" is a layout engine too
    try:
        yield
    finally:
        figure.set_layout_engine(engine)


def _packed(png: io.BytesIO) -> bytes:
    """Return the picture with fewer colours. They include the palette, because a partly covered line would have too few pixels to
    keep its colour."""
    from PIL import Image

    buffer = io.BytesIO()
    image = Image.open(png).convert("RGB")
    with_palette = Image.new("RGB", (image.width, image.height + PALETTE_ROWS))
    with_palette.paste(image)
    with_palette.paste(_swatches(image.width), (0, image.height))
    reduced = with_palette.quantize(PNG_COLOURS, dither=Image.Dither.NONE).crop((0, 0, *image.size))
    reduced.save(buffer, "PNG", dpi=(PIXELS_PER_INCH, PIXELS_PER_INCH))
    return buffer.getvalue()


def _swatches(width: int) -> Image.Image:
    """Return a strip with the palette's colours and the shades at the edges of lines."""
    from matplotlib.colors import to_rgb
    from PIL import Image

    ground = np.array(to_rgb("white" if Theme.current().colours == COLOURS else "black"))
    shares = np.linspace(0, 1, EDGE_SHADES + 1)[1:, None]
    shades = np.concatenate([(1 - shares) * ground + shares * np.array(to_rgb(one)) for one in Theme.current().colours])
    tiles = np.round(255 * shades).astype(np.uint8)[np.arange(width) * len(shades) // width]
    return Image.fromarray(np.broadcast_to(tiles, (PALETTE_ROWS, width, 3)).copy())


def adaptive(svg: str) -> str:
    """Return the SVG with shortened numbers and with a second set of colours for a dark background."""
    svg = re.sub(r"<!--.*?-->|<!DOCTYPE.*?>|<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"\n\s*", "\n", svg)
    svg = re.sub(r'(?<= d=")[^"]*|(?<=transform=")[^"]*|(?<= [xy]=")[^"]*', lambda found: _shortened(found[0]), svg)
    colours = sorted(set(re.findall(r"#[0-9a-f]{6}", svg)))
    rules = [
        f'[style*="{part}: {colour}"] {{ {part}: {dark} !important }}'
        for colour in colours
        if (dark := on_dark(colour)) is not None
        for part in ("fill", "stroke")
    ]
    black_text = f'[id^="text_"] {{ fill: {DARK_INK} }}'  # black is an SVG's default and is not written out
    style = "@media (prefers-color-scheme: dark) {\n" + "\n".join([black_text, *rules]) + "\n}"
    start = svg.index(">", svg.index("<svg ")) + 1
    return f"{svg[:start]}\n <style>{style}</style>{svg[start:]}"


def _shortened(path: str) -> str:
    """Round the numbers of a path to four digits or to a hundredth of a point. Glyphs have separate large units, and their scale
    is a small number."""

    def short(number: re.Match[str]) -> str:
        value = float(number[0])
        return f"{value:.2f}".rstrip("0").rstrip(".") if abs(value) >= 1 else f"{value:.4g}"

    return re.sub(r"-?\d+\.\d+", short, path).replace("\n", "")


def on_dark(colour: str) -> str | None:
    """Return the dark variant of a colour. Colours of the palette have dark variants; a grey becomes one that is as far from the
    dark background as the original is from white."""
    light = (c.lower() for c in (*COLOURS, INK, QUIET_INK, GROUND))
    named = dict(zip(light, (*ON_DARK, DARK_INK, DARK_QUIET_INK, DARK_GROUND), strict=True))
    if colour in named:
        return named[colour]
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    hue, lightness, saturation = colorsys.rgb_to_hls(red, green, blue)
    if saturation > 0.1:  # a colour of a map, whose scale must not change
        return None
    ground, ink = (int(end[1:3], 16) / 255 for end in (DARK_GROUND, DARK_INK))
    grey = ink + (ground - ink) * lightness
    return "#" + "".join(f"{round(255 * part):02x}" for part in colorsys.hls_to_rgb(hue, grey, saturation))


POWER = re.compile(r"\$\\mathdefault\{(?P<sign>-?)(?:(?P<mantissa>[\d.]+)\\times)?10\^\{(?P<exponent>-?\d+)\}\}\$")
"""Matplotlib's text for a power of ten."""


class PlainPowers(LogFormatterSciNotation):
    """Labels in plain notation, at the positions of Matplotlib's labels."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return plain(super().__call__(x, pos))


def plain(text: str) -> str:
    """Convert a number in mathtext to 0.2, 10 or 3·10⁻². Any other text is unchanged."""
    found = POWER.fullmatch(text)
    if found is None:
        return text
    mantissa, exponent = found["mantissa"] or "1", int(found["exponent"])
    return found["sign"] + (f"{float(mantissa) * 10.0**exponent:g}" if abs(exponent) <= 1 else times_power(mantissa, exponent))


def power_of_ten(value: float) -> str:
    """Format a whole power of ten as 0.1, 1 or 10, or with an exponent beyond these. Zero, which results from an underflow,
    gives an empty text."""
    if value <= 0:
        return ""
    exponent = round(math.log10(value))
    return f"{10.0**exponent:g}" if abs(exponent) <= 1 else times_power("1", exponent)


def with_plain_powers(figure: Figure) -> None:
    """Use plain powers on all logarithmic axes of a figure that have no other formatter."""
    insets = [inset for axes in figure.axes for inset in axes.child_axes if isinstance(inset, Axes)]
    for axes in (*figure.axes, *insets):
        for axis in (axes.xaxis, axes.yaxis):
            major, minor = axis.get_major_formatter(), axis.get_minor_formatter()
            if type(major) is LogFormatterSciNotation:
                axis.set_major_formatter(PlainPowers(labelOnlyBase=major.labelOnlyBase))
            if type(minor) is LogFormatterSciNotation:
                axis.set_minor_formatter(PlainPowers(labelOnlyBase=minor.labelOnlyBase))
