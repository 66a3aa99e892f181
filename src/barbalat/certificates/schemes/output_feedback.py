"""What the schemes that are a linear loop around y share: bounds of y and e by small gain, and their entries of Table 1."""

from __future__ import annotations

from typing import Any

from barbalat.certificates.bounds.output_loop import output_bounds
from barbalat.certificates.cells import Cell
from barbalat.certificates.rounding import up
from barbalat.controllers.output.l1 import L1Output
from barbalat.controllers.output.linear import LinearOutput
from barbalat.problem.output_feedback import OutputProblem
from barbalat.solvers.simulation import Simulation

REST = "plant, model and controller start at rest"


LINEAR_LOOP = "margins are exact for the linear loop named; limits at the input, and f(t, y), are not in it"

FROM_REST = (
    "(18): y = G(s)[u + d + f(t, y)], and what the case adds at input, output and sensor; G itself is exact",
    REST,
    "output_bound and error_bound: small gain in the L-infinity norm with the slope of f within the bound, 0 <= t <= t_end",
)

NEGLIGIBLE_STEADY_ERROR = 1e-9
"""Of a steady error per unit of r and d: what roundings leave of zero."""


def of_linear_loop(problem: OutputProblem, values: dict[str, Any], more: str, open_: str) -> dict[str, Cell]:
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
    if max(map(abs, steady.values())) < NEGLIGIBLE_STEADY_ERROR:
        return Cell("proven", "converges to zero for constant r and d")
    return Cell("proven", f"constant r and d leave {steady['r']:.4g} r and {steady['d']:.4g} d")


def bounds(
    problem: OutputProblem, controller: L1Output | LinearOutput, simulation: Simulation, findings: list[str]
) -> tuple[dict[str, Any], set[str]]:
    """Bounds of y, e and sigma in this case; without them, why."""
    found = output_bounds(problem, controller, simulation.t_end)
    if isinstance(found, str):
        findings.append(f"no bound of y: {found}")
        return {}, set()
    values: dict[str, Any] = {"norms": {"y/(d+f)": found.gain.ends}, "steady_error": dict(zip("rd", found.steady, strict=True))}
    limit = controller.sigma_bound if isinstance(controller, L1Output) else None
    if limit is not None:
        values["sigma_needed"] = found.sigma
        if found.sigma > limit:
            findings.append(
                f"no bound of y: inside its bounds sigma may need {found.sigma:.6g}, more than sigma_bound = {limit:g}, and what "
                "holds when the projection acts is not known"
            )
            return values, {"norms"}
    values |= {"output_bound": found.y, "error_bound": found.e}
    if problem.plant.f is not None:
        values["slope"] = found.slope
    return values, values.keys() - {"steady_error"}
