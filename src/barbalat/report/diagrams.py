"""Block diagrams: the L1 output-feedback controller as in the paper's Figure 1, and its equivalent linear controllers.

They are SVG drawings in which text remains text, so a page shows them in its font and colours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

from barbalat.controllers.output.l1 import L1Output, LinearEquivalent, fast_limit, linear_equivalent
from barbalat.linear.systems import TransferFunction
from barbalat.pictures.palette import COLOURS, ON_DARK
from barbalat.pictures.symbols import HAT, SUPERSCRIPTS, number_text, times_power
from barbalat.problem.output_feedback import OutputPlant, OutputProblem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.validate import Array

ADAPTIVE = "adaptive"
"""The CSS class of the scheme's adaptive part: predictor and integrator."""
RADIUS, BLOCK_HEIGHT = 0.16, 1.1
WIDTH, UNIT = 14.8, 60.0
"""Width of the drawing in units of length, and pixels per unit."""
FONT, LABEL, CHARACTER = 17.0, 15.0, 0.6
"""Largest size of a text and size of a line label [px]; width of a character in the widest of the usual fonts, as a fraction of
the size."""
Y_HAT = f"y{HAT}"
STYLE = (
    f"svg {{ color: #1a1a1a; font: {FONT}px serif }} .adaptive {{ color: {COLOURS[0]} }}"
    f" @media (prefers-color-scheme: dark) {{ svg {{ color: #e8e8e8 }} .adaptive {{ color: {ON_DARK[0]} }} }}"
    " rect, circle, path.line { fill: none; stroke: currentColor; stroke-width: 1.5 }"
    " text, path.head { fill: currentColor } .title { font-family: sans-serif }"
)

Point = tuple[float, float]
Fraction = tuple[str, str]
"""Numerator and denominator; the latter is empty if the text is a single line."""


def of_controller(controller: Controller, problem: TrackingProblem) -> str | None:
    """The block diagram of a scheme that has one (L1 output feedback), as SVG."""
    # only this scheme has a diagram, which is drawn block by block
    if isinstance(controller, L1Output) and isinstance(problem, OutputProblem):
        return l1_output(controller, problem.plant)
    return None


def l1_output(controller: L1Output, plant: OutputPlant) -> str:
    """Draw three loops, one below another: the scheme, its equivalent inside the bounds of sigma, and its limit for fast
    adaptation. Return the SVG."""
    inside = "inside the bounds of sigma" if controller.sigma_bound is not None else "everywhere, because sigma has no bounds"
    scheme = BlockDiagram(f"{controller.name}: the closed loop, as in Figure 1", top=4.1)
    equivalent = BlockDiagram(f"Its equivalent {inside}: a linear controller with a pole at s = 0", top=2.7)
    limit = BlockDiagram("For γ → ∞", top=2.7)
    _scheme(scheme, controller, plant)
    _equivalent(equivalent, linear_equivalent(controller), plant)
    _equivalent(limit, fast_limit(controller), plant)
    parts, height = [], 0.0
    for diagram in (scheme, equivalent, limit):
        parts.append(f'<g transform="translate({0.2 * UNIT:g} {height:g})">{diagram.svg}</g>')
        height += diagram.height
    described = escape(f"Block diagrams of {controller.name}", quote=True)
    head = f'xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{described}"'
    size = f'viewBox="0 0 {WIDTH * UNIT:g} {height:g}" width="{WIDTH * UNIT:g}" height="{height:g}"'
    return f"<svg {head} {size}><style>{STYLE}</style>{''.join(parts)}</svg>\n"


def _scheme(drawing: BlockDiagram, controller: L1Output, plant: OutputPlant) -> None:
    """Draw (18)-(21), with the predictor and its law in colour."""
    m, gamma = number_math(controller.m), number_math(controller.gamma)
    drawing.sum((1.0, 3.0))
    drawing.arrow((0.0, 3.0), (1.0 - RADIUS, 3.0), "r")
    drawing.block((3.3, 3.0), 2.8, transfer_function_text(controller.filter))
    drawing.arrow((1.0 + RADIUS, 3.0), (1.9, 3.0))
    drawing.arrow((4.7, 3.0), (7.2 - RADIUS, 3.0), "u")
    _plant(drawing, 7.2, 3.0, plant)
    drawing.arrow((12.0, 3.0), (14.2, 3.0), "y")
    drawing.line([(13.0, 3.0), (13.0, 1.4 + RADIUS)], arrow=True, colour=ADAPTIVE, sign="+")
    drawing.line([(5.8, 3.0), (5.8, 1.4 + RADIUS)], arrow=True, colour=ADAPTIVE, sign="+")
    drawing.sum((5.8, 1.4), ADAPTIVE)
    drawing.block((9.0, 1.4), 2.4, (m, f"s + {m}"), ADAPTIVE)
    drawing.arrow((5.8 + RADIUS, 1.4), (7.8, 1.4), colour=ADAPTIVE)
    drawing.arrow((10.2, 1.4), (13.0 - RADIUS, 1.4), Y_HAT, ADAPTIVE, sign="-")
    drawing.sum((13.0, 1.4), ADAPTIVE)
    bound = "" if controller.sigma_bound is None else f",  |σ| ≤ {number_math(controller.sigma_bound)}"
    drawing.block((9.0, -0.2), 3.4, (gamma, "s"), ADAPTIVE, beside=bound)
    drawing.line([(13.0, 1.4 - RADIUS), (13.0, -0.2), (10.7, -0.2)], arrow=True, colour=ADAPTIVE, label=f"y − {Y_HAT}")
    drawing.line([(7.3, -0.2), (1.0, -0.2), (1.0, 3.0 - RADIUS)], arrow=True, colour=ADAPTIVE, label="σ", sign="-")
    drawing.line([(5.8, -0.2), (5.8, 1.4 - RADIUS)], arrow=True, colour=ADAPTIVE, sign="+")


def _equivalent(drawing: BlockDiagram, linear: LinearEquivalent, plant: OutputPlant) -> None:
    """Draw u = F[r] - K[y] around the plant."""
    drawing.block((2.8, 1.6), 4.2, transfer_function_text(linear.feedforward))
    drawing.arrow((0.0, 1.6), (0.7, 1.6), "r")
    drawing.sum((5.8, 1.6))
    drawing.arrow((4.9, 1.6), (5.8 - RADIUS, 1.6))
    drawing.arrow((5.8 + RADIUS, 1.6), (7.2 - RADIUS, 1.6), "u")
    _plant(drawing, 7.2, 1.6, plant)
    drawing.arrow((12.0, 1.6), (14.2, 1.6), "y")
    drawing.block((9.4, -0.2), 4.2, transfer_function_text(linear.feedback))
    drawing.line([(13.0, 1.6), (13.0, -0.2), (11.5, -0.2)], arrow=True)
    drawing.line([(7.3, -0.2), (5.8, -0.2), (5.8, 1.6 - RADIUS)], arrow=True, sign="-")


def _plant(drawing: BlockDiagram, x: float, y: float, plant: OutputPlant) -> None:
    """Draw the sum at (x, y), where d enters, and G(s) up to x + 4.8. An input path and f(y) are labelled."""
    entering = "d" if plant.nonlinear is None else "d + f(y)"
    drawing.sum((x, y))
    drawing.line([(x, y + 0.8), (x, y + RADIUS)], arrow=True, sign="+", label=entering)
    drawing.block((x + 3.0, y), 3.6, transfer_function_text(plant.transfer_function))
    drawing.arrow((x + RADIUS, y), (x + 1.2, y))


@dataclass(frozen=True)
class BlockDiagram:
    """A drawing of blocks, sums and lines below a title. Coordinates are in units of length from the lower left."""

    title: str
    top: float
    parts: list[str] = field(default_factory=list)

    BOTTOM = -0.9

    @property
    def height(self) -> float:
        """The height in pixels, including the title."""
        return (self.top - self.BOTTOM) * UNIT + 2 * FONT

    @property
    def svg(self) -> str:
        return f'<text class="title" x="0" y="{1.3 * FONT:g}">{escape(self.title)}</text>{"".join(self.parts)}'

    def block(self, centre: Point, width: float, text: Fraction, colour: str = "", beside: str = "") -> None:
        """Draw a box with a fraction in it and a text to its right."""
        x, y = self._at(centre)
        wide, high = width * UNIT, BLOCK_HEIGHT * UNIT
        self._add(f'<rect x="{x - wide / 2:g}" y="{y - high / 2:g}" width="{wide:g}" height="{high:g}"/>', colour)
        longest = max(map(_length, text))
        characters = longest + _length(beside)
        size = min(FONT, 0.92 * wide / (CHARACTER * max(characters, 1)))
        x -= size * CHARACTER * _length(beside) / 2
        numerator, denominator = text
        if denominator:
            half = CHARACTER * size * longest / 2
            self._add(f'<path class="line" d="M{x - half:g} {y:g}h{2 * half:g}"/>', colour)
            self._text((x, y - 0.45 * size), numerator, "middle", colour, size)
            self._text((x, y + 1.1 * size), denominator, "middle", colour, size)
        else:
            self._text((x, y + 0.35 * size), numerator, "middle", colour, size)
        if beside:
            self._text((x + size * CHARACTER * longest / 2, y + 0.35 * size), beside, "start", colour, size)

    def sum(self, centre: Point, colour: str = "") -> None:
        x, y = self._at(centre)
        self._add(f'<circle cx="{x:g}" cy="{y:g}" r="{RADIUS * UNIT:g}"/>', colour)

    def arrow(self, start: Point, end: Point, label: str = "", colour: str = "", sign: str = "") -> None:
        self.line([start, end], arrow=True, label=label, colour=colour, sign=sign)

    def line(self, points: Sequence[Point], *, arrow: bool, label: str = "", colour: str = "", sign: str = "") -> None:
        """Draw a line through the points, with the label at the middle of the first segment and the sign at the arrowhead."""
        pixels = [self._at(point) for point in points]
        self._add(f'<path class="line" d="M{"L".join(f"{x:g} {y:g}" for x, y in pixels)}"/>', colour)
        (x_0, y_0), (x_1, y_1) = pixels[-2], pixels[-1]
        along = ((x_1 > x_0) - (x_1 < x_0), (y_1 > y_0) - (y_1 < y_0))
        if arrow:
            dx, dy = along
            sides = [(x_1 - 9 * dx + side * dy, y_1 - 9 * dy + side * dx) for side in (-4, 4)]
            self._add(f'<path class="head" d="M{x_1:g} {y_1:g}{"".join(f"L{x:g} {y:g}" for x, y in sides)}z"/>', colour)
        (a, b), (c, d) = pixels[:2]
        if label and a == c:
            self._text(((a + c) / 2 + 8, (b + d) / 2 + 0.35 * FONT), label, "start", colour, LABEL)
        elif label:
            self._text(((a + c) / 2, b - 6), label, "middle", colour, LABEL)
        if sign:
            left, below = (14, -14 * along[1]) if along[0] == 0 else (14, 22)
            self._text((x_1 - left, y_1 + below + 0.35 * FONT), "−" if sign == "-" else sign, "middle", colour)

    def _at(self, point: Point) -> Point:
        return point[0] * UNIT, (self.top - point[1]) * UNIT + 2 * FONT

    def _text(self, place: Point, text: str, anchor: str, colour: str, size: float = FONT) -> None:
        x, y = place
        self._add(f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}" font-size="{size:.3g}">{escape(text)}</text>', colour)

    def _add(self, element: str, colour: str) -> None:
        self.parts.append(f'<g class="{colour}">{element}</g>' if colour else element)


def _length(text: str) -> int:
    """The number of characters that take up width."""
    return len(text.replace(HAT, ""))


def transfer_function_text(system: TransferFunction) -> Fraction:
    """Return numerator and denominator with four digits. A denominator of 1 is returned as an empty text."""
    num, den = polynomial_text(system.num), polynomial_text(system.den)
    return num, "" if den == "1" else den


def polynomial_text(coefficients: Array) -> str:
    """Format a polynomial in s, highest power first: 3 s² − s + 0.5."""
    terms: list[str] = []
    degree = len(coefficients) - 1
    for power, value in zip(range(degree, -1, -1), coefficients.tolist(), strict=True):
        if value == 0:
            continue
        size = number_math(abs(value))
        variable = {0: "", 1: "s"}.get(power, f"s{str(power).translate(SUPERSCRIPTS)}")
        factor = "" if size == "1" and power else size
        sign = "−" if value < 0 else "+" if terms else ""
        terms.append(" ".join(part for part in (sign, factor, variable) if part))
    return " ".join(terms) or "0"


def number_math(value: float) -> str:
    """Format a number with four digits, with an exponent as a power of ten."""
    mantissa, _, exponent = number_text(value).partition("e")
    return times_power(mantissa, int(exponent)) if exponent else mantissa
