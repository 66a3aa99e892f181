"""Entries of Table 1 for the output-feedback schemes of Section IV, see docs/table-1.md."""

from __future__ import annotations

from typing import Any

from barbalat.adaptation.epsilon_modification import EpsilonModification
from barbalat.adaptation.fixed_sigma import FixedSigma
from barbalat.certify import laws
from barbalat.certify.analyses import Analysis, Cell, limits_text, margins_cell
from barbalat.certify.rounding import up
from barbalat.controllers.output.l1 import L1Output
from barbalat.controllers.output.linear import LinearOutput
from barbalat.controllers.output.lyapunov import LyapunovLaw
from barbalat.controllers.output.mrac import MracOutput
from barbalat.output_problem import OutputProblem

RESTS = 1e-9
"""Of a steady error per unit of r and d: what roundings leave of zero."""


def _mrac(problem: OutputProblem, controller: MracOutput, values: dict[str, Any]) -> tuple[str, dict[str, Cell]]:
    law, order = controller.law, len(problem.plant.transfer_function.poles)
    lyapunov = isinstance(law, LyapunovLaw)
    name = "MRAC with output feedback, " + ("unnormalised Lyapunov law" if lyapunov else "normalised law")
    modified = law.leakage is not None or getattr(law, "dead_zone", None) is not None  # type: ignore[union-attr]
    sentence = laws.output_convergence(law, controller.bind(problem.known).box)
    converges = not modified if lyapunov else "tracking error converges to zero" in sentence
    open_ = None
    if order > controller.order:
        open_ = f"the plant is of order {order} and the design of {controller.order}: the rest is unmodelled"
    elif problem.plant.f is not None:
        open_ = "f(t, y) acts, and the law knows linear plants only"
    elif "nothing is guaranteed" in sentence:
        open_ = sentence
    vanishing = Cell("proven", "converges to zero for every bounded r")
    kept = Cell("not proven", "converges to a set: the law is modified")
    auxiliary = "the auxiliary input leaves 1 - 1/(tau s + 1)^n* of the error, of the order of tau; no number"
    pulled = isinstance(law.leakage, (FixedSigma, EpsilonModification))  # type: ignore[union-attr]
    transient = Cell("proven", auxiliary) if controller.tau is not None and open_ is None else Cell("not proven", "no bound")
    return name, {
        "stability": Cell("proven", "for every bounded r") if open_ is None else Cell("not proven", open_),
        "tracking": (vanishing if converges else kept) if open_ is None else Cell("not proven", open_),
        "transient": transient,
        "estimates": _estimates(open_, pulled),
        "modelling_error": _robustness(controller),
        "tuning": Cell("estimate", limits_text(values)),
        "margins": margins_cell(values),
    }


def _estimates(open_: str | None, pulled: bool) -> Cell:
    if open_ is not None:
        return Cell("not proven", open_)
    if pulled:
        return Cell("proven", "bounded, and pulled towards zero")
    return Cell("proven", "V of the law never grows; they converge to theta* where the regressor is persistently exciting")


def _robustness(controller: MracOutput) -> Cell:
    law = controller.law
    if isinstance(law, LyapunovLaw):
        if law.leakage is None and law.dead_zone is None:
            return Cell("not proven", "not robust: the estimates may drift until the loop bursts (Rohrs)")
        return Cell(
            "not proven", "the estimates stay bounded; that all signals do is proven from a limited set of initial states only"
        )
    if controller.normalization.alpha_0 == 0:
        return Cell("not proven", "needs the dynamic normalisation, alpha_0 > 0 in (16); it is 0 here")
    bounded = controller.lower is not None or law.leakage is not None  # type: ignore[attr-defined]
    if not bounded:
        return Cell("not proven", "needs projection of all estimates or leakage, and there is neither")
    return Cell(
        "proven",
        "bounded, the mean square of e of the order of Delta, for every Delta that is small enough; how small is not computed",
    )


def _l1(problem: OutputProblem, controller: L1Output, values: dict[str, Any]) -> tuple[str, dict[str, Cell]]:
    condition = values.get("condition")
    value = "unknown" if condition is None or condition["value_upper"] is None else f"<= {up(condition['value_upper'])}"
    stated = f"condition (20): ||H(1 - C)||_1 L {value}"
    inside = ""
    if "sigma_needed" in values:
        inside = f"; |sigma| <= {up(values['sigma_needed'])} stays inside its bound {controller.sigma_bound:g}"
    return "L1 output feedback (18)-(21), a linear controller with integral action", {
        **_of_linear_loop(problem, values, f"{inside}; {stated}", f"no bound in this case; {stated}, for gamma -> infinity"),
        "estimates": Cell("estimate", "sigma is the state of an integrator, not a parameter: nothing is learnt"),
        "modelling_error": Cell("estimate", "that of its linear loop: see the margins"),
        "tuning": Cell("estimate", limits_text(values)),
        "margins": margins_cell(values),
    }


def _of_linear_loop(problem: OutputProblem, values: dict[str, Any], more: str, open_: str) -> dict[str, Cell]:
    """Boundedness, tracking and transient of a loop that is linear but for f."""
    if "output_bound" not in values:
        return {
            name: Cell("not proven", open_ if name == "stability" else "no bound")
            for name in ("stability", "tracking", "transient")
        }
    f = "" if problem.plant.f is None else f", where the slope of f is <= {up(values['slope'])}"
    return {
        "stability": Cell("proven", f"|y| <= {up(values['output_bound'])} up to t_end{f}{more}"),
        "tracking": _steady(problem, values["steady_error"]),
        "transient": Cell("proven", f"|y - y_m| <= {up(values['error_bound'])}"),
    }


def _steady(problem: OutputProblem, steady: dict[str, float]) -> Cell:
    if problem.plant.f is not None:
        return Cell("not proven", "not to zero in general: f(t, y) acts")
    if max(map(abs, steady.values())) < RESTS:
        return Cell("proven", "converges to zero for constant r and d")
    return Cell("proven", f"constant r and d leave {steady['r']:.4g} r and {steady['d']:.4g} d")


def _linear(problem: OutputProblem, __: LinearOutput, values: dict[str, Any]) -> tuple[str, dict[str, Cell]]:
    return "linear output feedback", {
        **_of_linear_loop(problem, values, "", "no bound in this case: see the certificate's findings"),
        "estimates": Cell("estimate", "it estimates nothing"),
        "modelling_error": Cell("estimate", "see the margins"),
        "tuning": Cell("estimate", "no adaptive gain"),
        "margins": margins_cell(values),
    }


OUTPUT_ANALYSES: dict[type, Analysis] = {MracOutput: _mrac, L1Output: _l1, LinearOutput: _linear}
