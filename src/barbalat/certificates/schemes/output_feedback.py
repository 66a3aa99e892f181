"""Bounds on y and e by small gain, and cells of Table 1, for the schemes that are a linear loop around y.

The bounds are guaranteed, by small gain in the L-infinity norm, for a loop that is linear except for f(t, y).

The loop of plant, model and linear controller is x' = A x + B [r; w; d_y] with w = d + f(t, y) and the output y_G of G. With
S = ||w -> y_G||_1, |f(t, y)| <= F + L |y| as long as |y| <= Y, and everything at rest at t = 0,

    |y_G| <= (||r -> y_G||_1 |r| + ||d_y -> y_G||_1 |d_y| + S (|d| + F))/(1 - S L)  where  S L < 1.

If the right side is below Y, y_G never reaches Y (it is continuous and starts at 0), and the bound holds for all time. Every
other signal follows from |w| <= |d| + F + L |y_G|, including sigma of the L1 controller, so the projection never acts if the
resulting bound on sigma is below the bound of the projection. Source: small-gain theorem, Desoer and Vidyasagar (1975), section
III.2; the norms are computed by ``l1``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from barbalat.certificates import theorems
from barbalat.certificates.assumptions import constant_in_the_end
from barbalat.certificates.bounds.formulas import largest_at_zero, largest_slope
from barbalat.certificates.cells import nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import NUMBERS_ALONE, Assumption, Entry, NotApplicable
from barbalat.certificates.grounds import plain
from barbalat.certificates.quantities import Form, Quantity
from barbalat.certificates.rows import up
from barbalat.linear.enclosure import OUTWARD_FACTOR, Enclosure
from barbalat.linear.l1_norms import l1_norm
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import column, symbols
from barbalat.problem.output_feedback import OutputProblem
from barbalat.protocols import BoundedSignal, Controller
from barbalat.signals import Constant
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

ENLARGEMENT_FACTOR = 1.05
"""Factor by which Y is repeatedly enlarged beyond the resulting bound, until it is large enough."""
MOST_ENLARGEMENTS = 200


@dataclass(frozen=True)
class OutputBounds:
    """Bounds for an output-feedback loop that hold at all times up to t_end.

    y, e    bounds on |y_G| and on |y - y_m|
    sigma   bound on |sigma|; 0 for a controller without sigma
    slope   slope of f over |y_G| <= y; 0 without f
    gain    ||w -> y_G||_1
    steady  the steady error for constant r = 1 and d = 1 without f, up to rounding
    """

    y: float
    e: float
    sigma: float
    slope: float
    gain: Enclosure
    steady: tuple[float, float]


def output_bounds(problem: OutputProblem, controller: Controller, t_end: float) -> OutputBounds | NotApplicable:
    """The bounds with a linear controller, such as an L1 controller without bounds on sigma."""
    drivers = _bounded_drivers(problem)
    if isinstance(drivers, NotApplicable):
        return drivers
    r, d, d_y = (0.0 if signal is None else signal.bound for signal in drivers)
    A, B, C, D = linear_loop(problem, controller)
    try:
        norms = [[l1_norm(A, B[:, [j]], C[[i]], D[i : i + 1, [j]]) for j in range(3)] for i in range(len(C))]
    except ValueError:
        return NotApplicable(f"the linear loop is unstable: a pole has real part {np.linalg.eigvals(A).real.max():.6g}")
    (y_r, y_w, y_d), *_ = norms
    gain, f = y_w.upper * OUTWARD_FACTOR, problem.plant.f
    rest = 0.0 if f is None else largest_at_zero(f, t_end)
    forced = (y_r.upper * r + y_d.upper * d_y + gain * (d + rest)) * OUTWARD_FACTOR
    found = (forced, 0.0) if f is None else _self_consistent(lambda Y: largest_slope(f, Y, t_end), gain, forced)
    if isinstance(found, NotApplicable):
        return found
    y, slope = found
    w = (d + rest + slope * y) * OUTWARD_FACTOR
    e, *sigma = ((of_r.upper * r + of_w.upper * w + of_d.upper * d_y) * OUTWARD_FACTOR for of_r, of_w, of_d in norms[1:])
    at_rest = D - C @ np.linalg.solve(A, B)
    return OutputBounds(y, e, sigma[0] if sigma else 0.0, slope, y_w, (float(at_rest[1, 0]), float(at_rest[1, 1])))


def _bounded_drivers(problem: OutputProblem) -> list[BoundedSignal | None] | NotApplicable:
    """Command and disturbances at input and output, or the reason why these bounds don't apply to the loop."""
    if not problem.plant.paths[0].is_linear or problem.delay > 0:
        return NotApplicable("limits or a delay at the plant's input are not covered")
    if problem.noise is not None:
        return NotApplicable("Gaussian noise has no bound")
    if problem.sensor is not None and problem.sensor.quantization is not None:
        return NotApplicable("a quantised measurement is not covered")
    drivers = (problem.reference, problem.disturbance, problem.output_disturbance)
    bounded = [signal for signal in drivers if signal is None or isinstance(signal, BoundedSignal)]
    return bounded if len(bounded) == len(drivers) else NotApplicable("a signal of the case has no known bound")


def _self_consistent(slope_within: Callable[[float], float], gain: float, forced: float) -> tuple[float, float] | NotApplicable:
    """A consistent pair: a bound on |y_G|, and the slope of f within it."""
    if not np.isfinite(forced):
        return NotApplicable("f(t, 0) has no bound that could be found")
    Y = forced
    for _ in range(MOST_ENLARGEMENTS):
        slope = slope_within(Y)
        if not gain * slope < 1:
            product = f"||w -> y||_1 = {gain:.6g} times the slope of f (up to {slope:.6g} for |y| <= {Y:.6g})"
            return NotApplicable(f"the small-gain condition fails: {product} is not below 1")
        bound = forced / (1 - gain * slope) * OUTWARD_FACTOR
        if bound * OUTWARD_FACTOR <= Y or Y == 0:
            return bound, slope
        Y = ENLARGEMENT_FACTOR * bound
    why = f"the slope of f grows with |y|, and no bound is reached below |y| = {Y:.6g}"
    return NotApplicable(f"the small-gain condition fails: {why}")


def linear_loop(problem: OutputProblem, controller: Controller) -> tuple[Array, Array, Array, Array]:
    """A, B, C, D from (r, w, d_y) to (y_G, e) and, if it exists, sigma, by exact Jacobians of the equations of the loop."""
    import casadi as ca

    plant = replace(problem.plant, nonlinear=None)
    driven = replace(problem, plant=plant, disturbance=Constant(), output_disturbance=Constant())
    loop = ClosedLoop.of(driven, controller)
    state_column, state = symbols("state", loop.size)
    signal_column, signals = symbols("signals", loop.signal_count)
    found = loop.outputs(state, signals)
    outputs = [loop.plant.output(found.x).reshape(1), found.e, found.theta_hat]
    slope, shown = column(loop.derivative(state, signals)), column(np.concatenate(outputs))
    jacobians = [ca.jacobian(value, by) for value in (slope, shown) for by in (state_column, signal_column)]
    A, B, C, D = ca.Function("jacobians", [state_column, signal_column], jacobians)(0, 0)
    return np.array(A), np.array(B), np.array(C), np.array(D)


def grounds_of_loop(problem: OutputProblem, controller: Controller, simulation: Simulation) -> dict[str, Any]:
    """The part of a proof that concerns the bounds: the matrices of the loop, and the bounds on f."""
    A, B, C, D = linear_loop(problem, controller)
    facts: dict[str, Any] = {"scheme": "output", "loop": {"A": plain(A), "B": plain(B), "C": plain(C), "D": plain(D)}}
    found, f = output_bounds(problem, controller, simulation.t_end), problem.plant.f
    if f is None or isinstance(found, NotApplicable):
        return facts | {"f": None}
    return facts | {"f": {"slope": found.slope, "at_zero": largest_at_zero(f, simulation.t_end)}}


OF_LINEAR_LOOPS = {
    "output_bound": Quantity("bound on |y| before disturbances at the output, up to t_end"),
    "steady_error": Quantity("the steady e for constant r and d without f", form=Form.PER_UNIT),
    "slope": Quantity("slope of f(t, y) in y within that bound"),
}
START_AT_REST = Assumption("plant, model and controller start at rest")
"""Holds by construction."""
LINEAR_LOOP = "margins are exact for the named linear loop, which does not include limits at the input or f(t, y)"
SMALL_GAIN = (
    Assumption("(18): y = G(s)[u + d + f(t, y)], and the case's disturbances and sensor; G itself is exact"),
    START_AT_REST,
    Assumption(
        "output_bound and error_bound: small gain in the L-infinity norm with the slope of f within the bound, 0 <= t <= t_end"
    ),
)
"""The loop whose norms are computed includes actuator, delay and sensor of the case; if these cannot be included,
``output_bounds`` gives no bound.
"""

NEGLIGIBLE_STEADY_ERROR = 1e-9
"""A steady error per unit of r and d below this is rounding error."""


def add_linear_loop(draft: Draft, problem: OutputProblem, controller: Controller, simulation: Simulation) -> OutputBounds | None:
    """Add the norm, the steady error and the bounds of the loop with a linear controller; without bounds, return None and add the
    reason."""
    found = output_bounds(problem, controller, simulation.t_end)
    if isinstance(found, NotApplicable):
        theorem = theorems.OUTPUT_LOOP if problem.plant.f is None else theorems.SLOPE
        draft.all_missing(("output_bound", "error_bound"), found.why, theorem=theorem)
        return None
    draft.guarantee("norms", {"y/(d+f)": found.gain.ends}, NUMBERS_ALONE)
    draft.exact({"steady_error": dict(zip("rd", found.steady, strict=True))}, "without f")
    return found


def add_bounds(draft: Draft, problem: OutputProblem, found: OutputBounds) -> None:
    """Add the bounds on y and e for this case."""
    draft.guarantee("output_bound", found.y, *SMALL_GAIN)
    draft.guarantee("error_bound", found.e, *SMALL_GAIN)
    if problem.plant.f is not None:
        draft.guarantee("slope", found.slope, *SMALL_GAIN)


def cells_of_linear_loop(problem: OutputProblem, certificate: Certificate, more: str = "") -> dict[str, Entry]:
    """Boundedness, tracking and transient of a loop that is linear except for f."""
    values, bound = certificate.values, certificate.entry("output_bound")
    if "output_bound" not in values:
        why = "no bound is known" if bound is None else bound.why
        return {name: nothing(name, why) for name in ("stability", "tracking", "transient")}
    f = "" if problem.plant.f is None else f", with a slope of f <= {up(values['slope'])}"
    return {
        "stability": statement("stability", f"|y| <= {up(values['output_bound'])} up to t_end{f}{more}", *SMALL_GAIN),
        "tracking": _steady(problem, values["steady_error"]),
        "transient": statement("transient", f"|y - y_m| <= {up(values['error_bound'])}", *SMALL_GAIN),
    }


def _steady(problem: OutputProblem, steady: dict[str, float]) -> Entry:
    if problem.plant.f is not None:
        return nothing("tracking", "e does not converge to zero in general: f(t, y) acts")
    text = "converges to zero for the case's r and d"
    if max(map(abs, steady.values())) >= NEGLIGIBLE_STEADY_ERROR:
        text = f"an error of {steady['r']:.4g} r and {steady['d']:.4g} d remains, where r and d have their final values"
    acts = "disturbance at the output" if problem.output_disturbance is not None else ""
    alone = Assumption("there is no disturbance at the output", acts)
    return statement("tracking", text, *SMALL_GAIN, constant_in_the_end(problem), alone)
