"""Chooses the schemes that a trade-off compares for a case, and the settings that it varies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from barbalat.certificates.certify import certify
from barbalat.certificates.step_limits.oscillator import Oscillator
from barbalat.controllers import SCHEMES, Mrac
from barbalat.controllers.tuning_grid import OutputTuningScale, Tunable, TuningGrid, TuningScale
from barbalat.problem.output_feedback import OutputProblem
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.run.engine.simulate import simulate
from barbalat.solvers.simulation import Simulation
from barbalat.study.ideal_benchmark import ideal
from barbalat.validate import Array, InputError


def default_knobs(
    problem: Problem, simulation: Simulation, *, density: int = 12, own: Sequence[Controller] = ()
) -> tuple[tuple[TuningGrid, ...], tuple[str, ...]]:
    """Return the knobs that the registered schemes declare, and sentences on omissions.

    density  number of values of a knob that is combined with another knob

    Gains extend up to the largest one that this step resolves, and time constants from five steps to the slowest one of the
    model. The sentences name omitted tunings and the schemes that do not support the problem. Raises InputError if no scheme
    supports it.

    own  user-defined controllers; each takes part with the knobs that it declares, or otherwise unchanged, as one tuning
    """
    reach, how = reach_of(problem, simulation, density=density)
    highest = reach.highest_gain
    candidates = [knobs for knobs in all_knobs(reach) if knobs.traded] + [knobs_of(one, reach) for one in own]
    names = [knobs.scheme for knobs in candidates]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError(f"two schemes of the trade-off have the name {twice!r}; give yours a different name")
    five = "five steps, " if simulation.tolerance is None else ""
    left_out = [
        f"{unresolved(highest, how, simulation)}, are omitted",
        f"time constants below {five}{SHORTEST_TIME_STEPS * simulation.resolution:g} s, are omitted",
    ]
    if reach.theta_hat0 is not None:
        usual = "0 is" if problem.known.theta_0 is None else "the baseline's parameters are"
        middle = ", ".join(f"{value:.6g}" for value in reach.theta_hat0)
        left_out.append(f"{usual} not in the known set, so estimates start at its centre, [{middle}]")
    kept, refused = [], []
    for knobs in candidates:
        try:
            knobs.make(**next(knobs.tunings())).bind(problem.known)
        except InputError as error:
            refused.append(f"{knobs.scheme} is omitted: {error}")
        else:
            kept.append(knobs)
    if not kept:
        raise InputError(f"no scheme takes part in the trade-off: {'; '.join(refused)}")
    return tuple(kept), (*left_out, *refused)


def unresolved(highest: float, how: str, simulation: Simulation) -> str:
    """Return a sentence on the gains above the ``highest`` gain that is tried."""
    if simulation.tolerance is None:
        return f"gains above {highest:.3g}, which {simulation.step} does not resolve ({how}: an estimate)"
    steps = STEPS_EACH_RESOLUTION * simulation.t_end / simulation.resolution
    return f"gains above {highest:.3g}, at which a run takes more than about {steps:.2g} steps ({how} for RK4: an estimate)"


STEPS_EACH_RESOLUTION = 2
"""Number of variable steps per longest stable step of RK4: a variable step covers about 1.5 rad of the fastest oscillation, and
the longest stable step 2.8 rad."""


def knobs_of(controller: Controller, reach: TuningScale) -> TuningGrid:
    """Return the knobs that a controller declares, or a single tuning if it declares none."""
    if isinstance(controller, Tunable):
        return controller.knobs(reach)
    return TuningGrid(scheme=controller.name, values={}, make=lambda: controller)


def all_knobs(reach: TuningScale) -> list[TuningGrid]:
    """Return the knobs of every registered scheme that has some."""
    return [scheme.knobs(reach) for scheme in SCHEMES.values() if isinstance(scheme, Tunable)]


def reach_of(problem: Problem, simulation: Simulation, *, density: int = 12) -> tuple[TuningScale, str]:
    """Return the ranges of the knobs for a case, and a text on how the largest gain was found."""
    highest, how = largest_gain(problem, simulation)
    reach = TuningScale(
        highest_gain=highest,
        highest_square=_oscillator(problem, simulation).largest_g(simulation.resolution),
        times=_times(np.linalg.eigvals(problem.plant.A_m), simulation, density),
        density=density,
        known=problem.known,
        sample_time=SHORTEST_TIME_STEPS * simulation.resolution,
        theta_hat0=start_of(problem),
    )
    return reach, how


def start_of(problem: Problem) -> Array | None:
    """Return the middle (p,) of a known set if the set excludes the default start (0 or a baseline's theta_0); otherwise None."""
    known_set, theta_0 = problem.known.theta_set, problem.known.theta_0
    if known_set is None or known_set.contains(np.zeros(len(known_set.middle)) if theta_0 is None else theta_0):
        return None
    return known_set.middle


def output_reach_of(problem: OutputProblem, simulation: Simulation, *, density: int = 12) -> OutputTuningScale:
    """Return the ranges of the knobs with output feedback, which include no gain."""
    return OutputTuningScale(
        times=_times(problem.known.W_m.poles, simulation, density),
        known=problem.known,
        sample_time=SHORTEST_TIME_STEPS * simulation.resolution,
        saturated=problem.known.saturation is not None,
    )


def _times(modes: Array, simulation: Simulation, density: int) -> Array:
    """Return time constants from the shortest one to that of the model's slowest mode [s]."""
    slowest = 1 / float(np.abs(modes.real).min())
    return np.geomspace(SHORTEST_TIME_STEPS * simulation.resolution, slowest, 3 * density)


SHORTEST_TIME_STEPS = 5
"""Number of solver steps in the shortest time constant, and in a sample of an inherently sampled controller."""


def largest_gain(problem: Problem, simulation: Simulation) -> tuple[float, str]:
    """Return an estimate of the largest Gamma that the step resolves, and a text on how it was found.

    For phi(x) = x, one input and a known gain, it is gamma_max of ``certify``. Otherwise it follows from the same frozen
    oscillator with the largest regressor of the loop with known theta, including u if its gain is estimated. The bound of
    ``certify`` covers everything that the known set allows, so it would exclude gains that cases use. Faults, a shell and an
    observer are ignored. Raises InputError if the step resolves no gain.
    """
    problem = problem.nominal
    if problem.fixed_observer is not None:  # no gamma_max is known for it
        problem = replace(problem.design, observer=None, sensor=None)
    if problem.plant.inputs == 1 and problem.plant.is_linear and problem.input_gain is None:
        plain = Mrac(gamma=1.0, theta_hat0=start_of(problem))
        found = certify(problem, (plain,), simulation.stepped, keys=("gamma_max",))[plain.name].values.get("gamma_max")
        how = "gamma_max of certify"
    else:
        found, how = _largest_along_the_ideal_run(problem, simulation), "the oscillator of adaptation with theta known"
    if not found:
        if simulation.tolerance is not None:
            raise InputError(
                "no adaptive gain is small enough for this command, because a run takes too many steps. Make the run shorter"
            )
        raise InputError(
            f"simulation.dt = {simulation.dt:g} s is too large to resolve any adaptive gain for this command; make it smaller"
        )
    return found, how


def _largest_along_the_ideal_run(problem: Problem, simulation: Simulation) -> float:
    known, controller = ideal(problem)
    run = simulate(known, [controller], replace(simulation, record_points=4000))[controller.name]
    if np.isfinite(diverged := run.metrics.diverged_at[0]):
        raise InputError(f"the plant cannot track its model: the loop diverges at t = {diverged:.4g} s even with theta known")
    square = np.array([np.sum(problem.plant.regressor(x) ** 2) for x in run.x])
    if problem.input_gain is not None:
        square += np.max(run.u.reshape(len(run.t), -1) ** 2, axis=1)
    largest = float(square.max())
    if largest == 0:
        raise InputError("the regressor phi(x) stays zero: give a command or an initial state")
    return _oscillator(problem, simulation).largest_g(simulation.resolution) / largest


def _oscillator(problem: Problem, simulation: Simulation) -> Oscillator:
    dynamics = [path.dynamics for path in problem.plant.paths]
    poles = np.concatenate([np.zeros(0), *(part.poles for part in dynamics if part is not None)])
    return Oscillator(problem.known, simulation.stepped.solver, poles)
