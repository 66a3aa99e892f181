"""Block diagrams: the L1 output-feedback controller as in the paper's Figure 1, and the linear controllers that it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from matplotlib.textpath import TextPath

from barbalat.controllers.output.l1 import L1Output, LinearEquivalent, fast_limit, linear_equivalent
from barbalat.linear.systems import TransferFunction
from barbalat.pictures.panels import text_of
from barbalat.pictures.symbols import number_text
from barbalat.problem.output_feedback import OutputPlant, OutputProblem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.validate import Array

INK = "#1a1a1a"
ADAPTIVE = "#0072B2"
"""What the scheme calls its adaptation: predictor and integrator."""
RADIUS = 0.16
WIDTH, INCHES = 14.8, 10.0
POINTS = 0.97 * 72 * INCHES / WIDTH
"""Of a unit of length on paper, less the margins."""
LARGEST_FONT_POINTS = 13.0
"""Of a block's text, however much room it has."""

Point = tuple[float, float]


def of_controller(controller: Controller, problem: TrackingProblem) -> Figure | None:
    """The block diagram of a scheme that has one: of L1 output feedback."""
    # drawn by hand for this one scheme, block by block: no controller could answer with it
    if isinstance(controller, L1Output) and isinstance(problem, OutputProblem):
        return l1_output(controller, problem.plant)
    return None


def l1_output(controller: L1Output, plant: OutputPlant) -> Figure:
    """Three loops, one below the other: the scheme, its equivalent inside the bounds of sigma, the limit of fast adaptation."""
    figure = Figure(figsize=(INCHES, 10.4), layout="constrained")
    FigureCanvasAgg(figure)
    scheme, equivalent, limit = figure.subplots(3, 1, height_ratios=[4.4, 3, 3])
    _scheme(BlockDiagram(scheme), controller, plant)
    scheme.set_title(f"{text_of(controller.name)}: the closed loop, as in Figure 1", fontsize="medium", loc="left")
    inside = "inside the bounds of sigma" if controller.sigma_bound is not None else "everywhere, for sigma has no bounds"
    _equivalent(BlockDiagram(equivalent), linear_equivalent(controller), plant)
    equivalent.set_title(f"What it is {inside}: a linear controller with a pole at s = 0", fontsize="medium", loc="left")
    _equivalent(BlockDiagram(limit), fast_limit(controller), plant)
    limit.set_title(r"For $\gamma \to \infty$", fontsize="medium", loc="left")
    for axes in (scheme, equivalent, limit):
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_xlim(-0.2, WIDTH - 0.2)
    return figure


def _scheme(drawing: BlockDiagram, controller: L1Output, plant: OutputPlant) -> None:
    """(18)-(21); the predictor and its law in colour."""
    m, gamma = number_math(controller.m), number_math(controller.gamma)
    drawing.axes.set_ylim(-0.9, 4.1)
    drawing.sum((1.0, 3.0))
    drawing.arrow((0.0, 3.0), (1.0 - RADIUS, 3.0), "$r$")
    drawing.block((3.3, 3.0), 2.8, transfer_function_text(controller.filter))
    drawing.arrow((1.0 + RADIUS, 3.0), (1.9, 3.0))
    drawing.arrow((4.7, 3.0), (7.2 - RADIUS, 3.0), "$u$")
    _plant(drawing, 7.2, 3.0, plant)
    drawing.arrow((12.0, 3.0), (14.2, 3.0), "$y$")
    drawing.line([(13.0, 3.0), (13.0, 1.4 + RADIUS)], arrow=True, colour=ADAPTIVE, sign="+")
    drawing.line([(5.8, 3.0), (5.8, 1.4 + RADIUS)], arrow=True, colour=ADAPTIVE, sign="+")
    drawing.sum((5.8, 1.4), ADAPTIVE)
    drawing.block((9.0, 1.4), 2.4, rf"$\dfrac{{{m}}}{{s + {m}}}$", ADAPTIVE)
    drawing.arrow((5.8 + RADIUS, 1.4), (7.8, 1.4), colour=ADAPTIVE)
    drawing.arrow((10.2, 1.4), (13.0 - RADIUS, 1.4), r"$\hat y$", ADAPTIVE, sign="-")
    drawing.sum((13.0, 1.4), ADAPTIVE)
    bound = "" if controller.sigma_bound is None else rf",  $|\sigma| \leq {number_math(controller.sigma_bound)}$"
    drawing.block((9.0, -0.2), 3.4, rf"$\dfrac{{{gamma}}}{{s}}${bound}", ADAPTIVE)
    drawing.line([(13.0, 1.4 - RADIUS), (13.0, -0.2), (10.7, -0.2)], arrow=True, colour=ADAPTIVE, label=r"$y - \hat y$")
    drawing.line([(7.3, -0.2), (1.0, -0.2), (1.0, 3.0 - RADIUS)], arrow=True, colour=ADAPTIVE, label=r"$\sigma$", sign="-")
    drawing.line([(5.8, -0.2), (5.8, 1.4 - RADIUS)], arrow=True, colour=ADAPTIVE, sign="+")


def _equivalent(drawing: BlockDiagram, linear: LinearEquivalent, plant: OutputPlant) -> None:
    """u = F[r] - K[y] around the plant."""
    drawing.axes.set_ylim(-0.9, 2.7)
    drawing.block((2.8, 1.6), 4.2, transfer_function_text(linear.feedforward))
    drawing.arrow((0.0, 1.6), (0.7, 1.6), "$r$")
    drawing.sum((5.8, 1.6))
    drawing.arrow((4.9, 1.6), (5.8 - RADIUS, 1.6))
    drawing.arrow((5.8 + RADIUS, 1.6), (7.2 - RADIUS, 1.6), "$u$")
    _plant(drawing, 7.2, 1.6, plant)
    drawing.arrow((12.0, 1.6), (14.2, 1.6), "$y$")
    drawing.block((9.4, -0.2), 4.2, transfer_function_text(linear.feedback))
    drawing.line([(13.0, 1.6), (13.0, -0.2), (11.5, -0.2)], arrow=True)
    drawing.line([(7.3, -0.2), (5.8, -0.2), (5.8, 1.6 - RADIUS)], arrow=True, sign="-")


def _plant(drawing: BlockDiagram, x: float, y: float, plant: OutputPlant) -> None:
    """The sum at (x, y) where d enters, and G(s) up to x + 4.8; a path of the input and f(y) are named."""
    entering = r"$d$" if plant.nonlinear is None else r"$d + f(y)$"
    drawing.sum((x, y))
    drawing.line([(x, y + 0.8), (x, y + RADIUS)], arrow=True, sign="+", label=entering)
    drawing.block((x + 3.0, y), 3.6, transfer_function_text(plant.transfer_function))
    drawing.arrow((x + RADIUS, y), (x + 1.2, y))


@dataclass(frozen=True)
class BlockDiagram:
    """Blocks, sums and lines in the axes' own units."""

    axes: Axes

    def block(self, centre: Point, width: float, text: str, colour: str = INK) -> None:
        x, y = centre
        self.axes.add_patch(Rectangle((x - width / 2, y - 0.55), width, 1.1, fill=False, edgecolor=colour, linewidth=1.2))
        room = 0.92 * width * POINTS / TextPath((0, 0), text, size=1).get_extents().width
        self.axes.text(x, y, text, ha="center", va="center", fontsize=min(LARGEST_FONT_POINTS, room), color=colour)

    def sum(self, centre: Point, colour: str = INK) -> None:
        self.axes.add_patch(Circle(centre, RADIUS, fill=False, edgecolor=colour, linewidth=1.2))

    def arrow(self, start: Point, end: Point, label: str = "", colour: str = INK, sign: str = "") -> None:
        self.line([start, end], arrow=True, label=label, colour=colour, sign=sign)

    def line(self, points: Sequence[Point], *, arrow: bool, label: str = "", colour: str = INK, sign: str = "") -> None:
        """Through the points; the label at the middle of the first stretch, the sign where the arrow ends."""
        xs, ys = zip(*points, strict=True)
        self.axes.plot(xs[:-1] if arrow else xs, ys[:-1] if arrow else ys, color=colour, linewidth=1.2)
        (x_0, y_0), (x_1, y_1) = points[-2], points[-1]
        if arrow:
            style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0}
            self.axes.annotate("", (x_1, y_1), (x_0, y_0), arrowprops=style)
        (a, b), (c, d) = points[0], points[1]
        x, y = (a + c) / 2, (b + d) / 2
        if label and a == c:
            self.axes.text(x + 0.12, y, label, ha="left", va="center", color=colour, fontsize=12)
        elif label:
            self.axes.text(x, y + 0.08, label, ha="center", va="bottom", color=colour, fontsize=12)
        if sign:
            left, below = (0.22, 0.2 if y_1 > y_0 else -0.2) if x_0 == x_1 else (0.2, 0.24)
            self.axes.text(x_1 - left, y_1 - below, f"${sign}$", ha="center", va="center", fontsize=10, color=colour)


def transfer_function_text(system: TransferFunction) -> str:
    """Return the transfer function as mathtext with four digits, without a denominator of 1."""
    num, den = polynomial_text(system.num), polynomial_text(system.den)
    return f"${num}$" if den == "1" else rf"$\dfrac{{{num}}}{{{den}}}$"


def polynomial_text(coefficients: Array) -> str:
    """In s, highest power first: 3 s^2 - s + 0.5."""
    terms: list[str] = []
    degree = len(coefficients) - 1
    for power, value in zip(range(degree, -1, -1), coefficients.tolist(), strict=True):
        if value == 0:
            continue
        size = number_math(abs(value))
        variable = {0: "", 1: "s"}.get(power, f"s^{{{power}}}")
        factor = "" if size == "1" and power else size
        sign = "-" if value < 0 else "+" if terms else ""
        terms.append(" ".join(part for part in (sign, factor, variable) if part))
    return " ".join(terms) or "0"


def number_math(value: float) -> str:
    """Four digits; a power of ten as such."""
    text = number_text(value)
    if "e" not in text:
        return text
    mantissa, exponent = text.split("e")
    power = rf"10^{{{int(exponent)}}}"
    return power if mantissa == "1" else rf"{mantissa} \cdot {power}"
