"""Claims on output feedback: the structure of the L1 controller, the SISO scheme, and Rohrs' counterexample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from barbalat.adaptation.lyapunov import LyapunovLaw
from barbalat.adaptation.modifications import DeadZone
from barbalat.cases.build import Case
from barbalat.cases.load import load_case
from barbalat.controllers.output.l1 import L1Output, linear_equivalent
from barbalat.controllers.output.linear import LinearOutput
from barbalat.controllers.output.mrac import MracOutput
from barbalat.papers.claim import Claim, Listing, Measurement, span, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013.section_v import at_instants
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.problem.actuation import PlantInput
from barbalat.problem.output_feedback import OutputProblem
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.run.results.result import Result
from barbalat.signals import Step
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


def l1_is_linear() -> Claim:
    """Compare the controller with its linear equivalent, under a constant disturbance and under saturation with and without the
    bound on sigma."""
    case = load_case("l1-output")
    assert isinstance(case.problem, OutputProblem)
    controller = next(c for c in case.controllers if isinstance(c, L1Output))
    same = linear_equivalent(controller)
    linear = LinearOutput(loop=same.feedback, feedforward=same.feedforward, name="equivalent")
    runs = simulate(case.problem, [controller, linear], replace(case.simulation, t_end=20.0))
    difference = float(np.abs(runs[controller.name].u - runs["equivalent"].u).max() / np.abs(runs["equivalent"].u).max())
    constant = replace(case.problem, reference=Step(amplitude=1.0), disturbance=Step(amplitude=1.0, start=5.0))
    left = float(np.abs(simulate(constant, [controller], Simulation(t_end=30.0, dt=1e-3))[controller.name].e[-1, 0]))
    late = _after_saturation(case.problem, controller)
    sentence = SENTENCES["l1-output-is-lti"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(difference < 1e-9, f"it differs by {difference:.1g} of the largest |u|"),
            sentence.reads(left < 1e-9, f"an error |e| = {left:.1g} remains", 1),
            sentence.reads(
                late[0] < 0.5 * late[1],
                f"after saturation the mean |e| is {late[0]:.2g} with the projection and {late[1]:.2g} without it",
                2,
            ),
        ),
        shows=f"While sigma is inside its bounds, u differs from that of a linear controller by {difference:.0e} of the largest "
        "|u|.",
        measured=f"its control differs from that of the linear equivalent by {difference:.1g} of the largest |u| while sigma is "
        f"inside its bounds. A constant disturbance leaves an error |e| = {left:.1g}. After 5 s of saturation the mean |e| of "
        f"the next 8 s is {late[0]:.2g} with the projection and {late[1]:.2g} without",
        how="plant 2/(s + 1) with 0.5 sin y, m = 3, C = 30/(s + 30), gamma = 1e4 (50 under saturation), RK4; the linear "
        "equivalent is multiplied out and integrated as a separate realisation",
        listings=(_compared_with_equivalent(runs[controller.name], runs["equivalent"]),),
        would_change="an input for which the two controls differ while sigma is inside its bounds; the row does not concern "
        "other L1 controllers",
    )


def _compared_with_equivalent(adaptive: Result, linear: Result) -> Listing:
    at = at_instants(adaptive.t, TOLD_INSTANTS)
    u, difference = adaptive.u[at], adaptive.u[at] - linear.u[at]
    return table(
        "The control compared with that of the linear equivalent",
        {"t [s]": TOLD_INSTANTS, "u": u, "u - u of the equivalent": difference},
    )


TOLD_INSTANTS = (0.0, 1.0, 2.0, 5.0, 10.0, 20.0)
"""Instants [s] at which the controller and its linear equivalent are compared. The run ends at 20 s."""


def _after_saturation(problem: OutputProblem, controller: L1Output) -> tuple[float, float]:
    """Return the mean |e| in the 8 s after a disturbance that saturated the input, with sigma bounded and with sigma free."""
    plant = replace(problem.plant, input=PlantInput(saturation=(-1.0, 1.0)), nonlinear=None)
    hit = replace(problem, plant=plant, reference=Step(amplitude=1.0), disturbance=Step(amplitude=4.0, start=6.0, constant=-4.0))
    pair = [replace(controller, gamma=50.0, sigma_bound=bound, name=name) for name, bound in (("bounded", 3.0), ("free", None))]
    runs = simulate(hit, pair, Simulation(t_end=16.0, dt=1e-3))
    bounded, free = (float(np.abs(run.e[(run.t > 7) & (run.t < 15), 0]).mean()) for run in runs.values())
    return bounded, free


DEAD_ZONES = (0.1, 0.2, 0.3, 0.34, 0.38, 0.42)
"""Half-widths of the dead zone that are tried in addition to the one in the case."""
LEAST_PATH = 0.1
"""Smallest path length of estimates that count as adapting. All estimates are of order one, so an estimate that moves less than
this in 80 s does not adapt."""


def rohrs() -> Claim:
    """Compare the classical law and its remedies on one plant, and measure how much each law still adapts."""
    case = load_case("rohrs")
    runs = simulate(case.problem, case.controllers, case.simulation)
    classical, resting = runs.pop("Classical"), runs.pop("Not adapting")
    bounded = {name: run for name, run in runs.items() if run.diverged_at is None}
    ended = _dead_zones(case)
    lost = [g_0 for g_0, at in zip(DEAD_ZONES, ended, strict=True) if np.isfinite(at)]
    heights = _heights(bounded)
    adapting = [name for name, run in bounded.items() if _moved(run) > LEAST_PATH]
    falls = f"diverges at t = {classical.diverged_at:.4g} s" if classical.diverged_at else "stays bounded"
    sentence = SENTENCES["rohrs"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(classical.diverged_at is not None, f"it {falls}"),
            sentence.reads(len(bounded) == len(runs), f"{len(bounded)} of {len(runs)} do over {case.simulation.t_end:g} s", 1),
            Reading(
                "a dead zone of any width keeps the loop bounded",
                not lost,
                f"with {len(lost)} of {len(DEAD_ZONES)} further dead zones the loop diverges",
                "beside",
            ),
            Reading(
                "the modified laws continue to adapt",
                len(adapting) == len(bounded),
                f"{', '.join(adapting) or 'none'}: their estimates move by more than {LEAST_PATH:g} in total",
                "beside",
            ),
        ),
        shows=f"The classical law {falls}; {len(bounded)} of {len(runs)} modified laws stay bounded.",
        measured=f"the classical law {falls}, and {len(bounded)} of {len(runs)} modified laws stay bounded; max |y| of the other "
        f"laws over {case.simulation.t_end:g} s is {span(heights)}, and {resting.figures['max_abs_y']:.3g} without adaptation. "
        f"The dead zone keeps the loop bounded by stopping the adaptation. With {len(lost)} of {len(DEAD_ZONES)} further dead "
        f"zones, g_0 = {span(DEAD_ZONES)}, the loop diverges" + (f"; these have g_0 = {span(lost)}" if lost else ""),
        how="Rohrs' plant and command 0.3 + 1.85 sin 16.1 t, RK4, h = 1e-4 s; dead zones at h = 1e-3 s",
        listings=(
            _motions(bounded, case.simulation.t_end),
            table(
                "Narrower and wider dead zones: the time at which the run diverges, or - if it does not",
                {"g_0": DEAD_ZONES, "diverges at [s]": ended},
            ),
        ),
        would_change="a bounded run of the classical law, or an unbounded run of sigma-modification, normalisation or the robust law",
    )


def _heights(runs: dict[str, Result]) -> Array:
    """Return the largest |y| of each law."""
    return np.array([run.figures["max_abs_y"] for run in runs.values()], dtype=float)


def _motions(runs: dict[str, Result], t_end: float) -> Listing:
    return table(
        f"The modified laws over {t_end:g} s: the largest |y|, and the total path of their estimates",
        {"law": list(runs), "max |y|": _heights(runs), "path": [_moved(run) for run in runs.values()]},
    )


def _moved(run: Result) -> float:
    """Return the length of the path of all estimates."""
    return float(np.linalg.norm(run.envelope.theta_hat_path.sum(axis=0)))


def _dead_zones(case: Case) -> Array:
    """Return the time [s] at which the classical law diverges, for each of ``DEAD_ZONES``; NaN if it does not diverge."""
    classical = next(c for c in case.controllers if isinstance(c, MracOutput) and c.name == "Classical")
    assert isinstance(classical.law, LyapunovLaw)
    tried = [replace(classical, law=replace(classical.law, dead_zone=DeadZone(g_0=g_0))) for g_0 in DEAD_ZONES]
    simulation = replace(case.simulation, dt=1e-3)
    return np.asarray(simulate_ensemble([(case.problem, controller) for controller in tried], simulation).metrics.diverged_at)


ROWS = (
    Measurement(l1_is_linear, 0.6, {"l1-output-is-lti": "the L1 output-feedback controller is linear"}, place=350),
    Measurement(rohrs, 1.0, {"rohrs": "Rohrs' example"}, place=380),
)
