"""The L1 law used in flight. Section IV's statement about the output-feedback law, that it is a linear controller, is tested on
it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from barbalat.cases.load import load_case
from barbalat.certificates.certify import certify
from barbalat.controllers import L1PiecewiseConstant
from barbalat.controllers.l1_piecewise import realisation, started
from barbalat.papers.claim import Claim, Measurement, table
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.problem.state_feedback import Problem
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Constant, Step
from barbalat.solvers.simulation import Simulation

STEPS_A_SAMPLE = 2
ROUNDING_SHARE = 1e-9
"""Largest difference due to rounding, as a fraction of the largest |u|. It arises from sums in a different order, divided by the
sample time."""
TRIED_POLES = (-10.0, -5.0, -1.0, 0.0)
"""The flown predictor's a [1/s]."""


def is_linear() -> Claim:
    """Compare both forms with their realisations, and measure the remaining effect of a constant disturbance for several poles of
    the predictor and in the limit."""
    problem, laws = _case()
    differences = {law.name: _difference(problem, law) for law in laws}
    difference = max(differences.values())
    flown = next(law for law in laws if law.as_flown is not None)
    left = [_left(problem, flown, a) for a in TRIED_POLES]
    keys = ("delay_margin",)
    margins = [certify(problem, [law], _simulation(law), keys=keys)[law.name].values["delay_margin"] for law in laws]
    sentence = SENTENCES["l1-piecewise-is-lti"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(difference < ROUNDING_SHARE, f"it differs by {difference:.1g} of the largest |u|, in both forms"),
            sentence.reads(max(left) < ROUNDING_SHARE, f"|e_1| = {left[1]:.2g} remains with a = {TRIED_POLES[1]:g}/s, and "
            f"{left[-1]:.1g} with a = 0", 1),
        ),
        shows=f"The law differs from a linear controller by {difference:.0e} of the largest |u|; a constant disturbance leaves "
        f"|e_1| = {left[1]:.1g} with a = {TRIED_POLES[1]:g}/s and {left[-1]:.0e} with a = 0.",
        measured=f"its control differs from that of its realisation by {difference:.1g} of the largest |u|. Its estimate is a "
            f"difference of two measurements. With a = {TRIED_POLES[1]:g}/s at {1 / flown.sample_time:g} Hz it misses "
            f"{100 * -np.expm1(TRIED_POLES[1] * flown.sample_time):.3g} % of a constant disturbance; with a = 0 it includes all "
            f"of it. "
        "Its margins are exact, as for any linear controller: it tolerates "
        f"a further delay of {' and '.join(f'{1e3 * margin:.1f} ms' for margin in margins)}",
        how="bundled case quadrotor-pitch without its limits: motor lag 0.04 s, delay 2.5 ms, RK4, two steps per sample. The "
            "law is used in its exact and in its as-flown form. The linear realisation is multiplied out and runs on the same "
            "measurements",
        listings=(
            table(
                "The remaining effect of a constant disturbance of 0.05 N m in the as-flown form, for each predictor pole",
                {"a [1/s]": TRIED_POLES, "|e_1| [rad]": left},
            ),
        ),
        would_change="an input for which the law and its realisation differ by more than rounding, while no limit acts",
    )  # fmt: skip


def _case() -> tuple[Problem, list[L1PiecewiseConstant]]:
    """Return the bundled case as a linear loop."""
    case = load_case("quadrotor-pitch")
    assert isinstance(case.problem, Problem)
    (path,) = case.problem.plant.paths
    problem = replace(case.problem, plant=replace(case.problem.plant, input=replace(path, saturation=None)))
    laws = [law for law in case.controllers if isinstance(law, L1PiecewiseConstant)]
    return problem, [replace(law, saturated_predictor=False) for law in laws]


def _simulation(law: L1PiecewiseConstant, t_end: float = 12.0) -> Simulation:
    dt = law.sample_time / STEPS_A_SAMPLE
    return Simulation(t_end=t_end, dt=dt, record_points=round(t_end / dt))


def _difference(problem: Problem, law: L1PiecewiseConstant) -> float:
    """Return the largest difference of u relative to the largest |u|."""
    run = simulate(problem, [law], _simulation(law))[law.name]
    x, r, u = (values[::STEPS_A_SAMPLE] for values in (run.x, run.r, run.u))
    equations = law.bind(problem.known)
    same, state, found = realisation(equations), started(equations, x[0], r[0]), []
    for measured in np.column_stack([x, r]):
        found.append((same.C @ state + same.D @ measured)[0])
        state = same.A @ state + same.B @ measured
    return float(np.abs(np.array(found) - u).max() / np.abs(u).max())


def _left(problem: Problem, law: L1PiecewiseConstant, a: float) -> float:
    """Return |e_1| at the end of 40 s with a constant disturbance and no command."""
    assert law.as_flown is not None
    tried = replace(law, as_flown=replace(law.as_flown, predictor_poles=a))
    constant = replace(problem, reference=Constant(0.0), disturbance=Step(amplitude=0.05, start=1.0))
    return float(np.abs(simulate(constant, [tried], _simulation(law, 40.0))[law.name].e[-1, 0]))


ROWS = (Measurement(is_linear, 2.5, {"l1-piecewise-is-lti": "the L1 controller used in flight is linear"}, place=360),)
