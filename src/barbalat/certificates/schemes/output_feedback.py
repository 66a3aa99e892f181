"""What the schemes that are a linear loop around y share: bounds of y and e by small gain, and their cells of Table 1."""

from __future__ import annotations

from barbalat.certificates.assumptions import constant_in_the_end
from barbalat.certificates.bounds.output_loop import OutputBounds, output_bounds
from barbalat.certificates.cells import nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import NUMBERS_ALONE, Assumption, Entry, NotApplicable
from barbalat.certificates.quantities import Form, Quantity
from barbalat.certificates.rounding import up
from barbalat.problem.output_feedback import OutputProblem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation

OF_LINEAR_LOOPS = {
    "output_bound": Quantity("of |y| before what is added at the output, up to t_end"),
    "steady_error": Quantity("what constant r and d leave of e without f", form=Form.PER_UNIT),
    "slope": Quantity("of f(t, y) in y within that bound"),
}
START_AT_REST = Assumption("plant, model and controller start at rest")
"""Holds by construction."""
LINEAR_LOOP = "margins are exact for the linear loop named; limits at the input, and f(t, y), are not in it"
SMALL_GAIN = (
    Assumption("(18): y = G(s)[u + d + f(t, y)], and what the case adds at input, output and sensor; G itself is exact"),
    START_AT_REST,
    Assumption(
        "output_bound and error_bound: small gain in the L-infinity norm with the slope of f within the bound, 0 <= t <= t_end"
    ),
)
"""What the case adds is in the loop whose norms are taken; where it can't be, ``output_bounds`` gives none."""

NEGLIGIBLE_STEADY_ERROR = 1e-9
"""Of a steady error per unit of r and d: what roundings leave of zero."""


def add_linear_loop(draft: Draft, problem: OutputProblem, controller: Controller, simulation: Simulation) -> OutputBounds | None:
    """Norm and steady error of the loop around a linear controller, and its bounds; None, with the reason, without them."""
    found = output_bounds(problem, controller, simulation.t_end)
    if isinstance(found, NotApplicable):
        for key in ("output_bound", "error_bound"):
            draft.missing(key, found.why)
        return None
    draft.guarantee("norms", {"y/(d+f)": found.gain.ends}, NUMBERS_ALONE)
    draft.exact({"steady_error": dict(zip("rd", found.steady, strict=True))}, "without f")
    return found


def add_bounds(draft: Draft, problem: OutputProblem, found: OutputBounds) -> None:
    """The bounds of y and e in this case."""
    draft.guarantee("output_bound", found.y, *SMALL_GAIN)
    draft.guarantee("error_bound", found.e, *SMALL_GAIN)
    if problem.plant.f is not None:
        draft.guarantee("slope", found.slope, *SMALL_GAIN)


def cells_of_linear_loop(problem: OutputProblem, certificate: Certificate, more: str = "") -> dict[str, Entry]:
    """Boundedness, tracking and transient of a loop that is linear but for f."""
    values, bound = certificate.values, certificate.entry("output_bound")
    if "output_bound" not in values:
        why = "no bound is known" if bound is None else bound.why
        return {name: nothing(name, why) for name in ("stability", "tracking", "transient")}
    f = "" if problem.plant.f is None else f", where the slope of f is <= {up(values['slope'])}"
    return {
        "stability": statement("stability", f"|y| <= {up(values['output_bound'])} up to t_end{f}{more}", *SMALL_GAIN),
        "tracking": _steady(problem, values["steady_error"]),
        "transient": statement("transient", f"|y - y_m| <= {up(values['error_bound'])}", *SMALL_GAIN),
    }


def _steady(problem: OutputProblem, steady: dict[str, float]) -> Entry:
    if problem.plant.f is not None:
        return nothing("tracking", "not to zero in general: f(t, y) acts")
    text = "converges to zero for the case's r and d"
    if max(map(abs, steady.values())) >= NEGLIGIBLE_STEADY_ERROR:
        text = f"leaves {steady['r']:.4g} r and {steady['d']:.4g} d, as they are in the end"
    acts = "disturbance at the output" if problem.output_disturbance is not None else ""
    alone = Assumption("nothing is added at the output", acts)
    return statement("tracking", text, *SMALL_GAIN, constant_in_the_end(problem), alone)
