"""The margins and peak gains of a linear loop, under the keys of the certificate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from barbalat.certificates.assumptions import LINEAR_LOOP_ONLY
from barbalat.certificates.bounds.laws import is_modified
from barbalat.certificates.certificate import Draft
from barbalat.certificates.entry import PlaceOfRest, RestingEstimates
from barbalat.certificates.linear_loops.ideal import around_equilibrium
from barbalat.certificates.picture import MarginLoop
from barbalat.certificates.quantities import EACH_INPUT
from barbalat.certificates.requested_keys import is_left_out, is_needed
from barbalat.controllers import L1Adaptive, Mrac
from barbalat.linear.margins import margins
from barbalat.linear.peaks import delayed_peaks, peak_gain
from barbalat.linear.systems import StateSpace, complementary_sensitivity, sensitivity, series
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import BoundedSignal
from barbalat.roles import THETA
from barbalat.validate import InputError

KEYS_OF_MARGINS = {
    "delay": "delay_margin",
    "phase": "phase_margin",
    "gain_up": "gain_margin",
    "gain_down": "gain_reduction_margin",
}
"""The certificate's keys for the entries of ``Margins``."""
PLAIN_LAW_ONLY = "it is given only for the plain law: with the modification the loop has a different equilibrium"
"""The reason why a law with leakage, a dead zone or a memory has no margin that includes the law."""


UNSTABLE_WITH_LAW = "with its law linearised at the largest command, the loop is unstable"
"""The beginning of the reason why an unstable loop with its law has no margin."""


def add_margins(
    draft: Draft,
    problem: TrackingProblem,
    loop: StateSpace,
    which: str,
    assumed: str = LINEAR_LOOP_ONLY,
    rest: PlaceOfRest | None = None,
) -> None:
    """Add margins and peaks of the named loop, including the plant's input dynamics and delay."""
    if is_left_out("delay_margin"):
        return
    with draft.part("delay_margin"):
        _add_margins(draft, problem, loop, which, assumed, rest)


def _add_margins(
    draft: Draft, problem: TrackingProblem, loop: StateSpace, which: str, assumed: str, rest: PlaceOfRest | None
) -> None:
    found = margins_of(problem, loop, which, draft.notes)
    if not found:
        return
    name = f"{which}, broken at the plant input{in_the_loop(problem)}"
    draft.exact(found, name, assumed, rest=rest)
    draft.loops.append(MarginLoop(which, with_dynamics(problem, loop), problem.delay))
    draft.advise({"margins_of": f"the linear loop {name}"})


def add_margins_of_each(
    draft: Draft, problem: TrackingProblem, loops: Sequence[StateSpace], which: str, rest: PlaceOfRest | None = None
) -> None:
    """Add the margins of each input: each loop is broken at one input and includes the dynamics of all inputs."""
    if is_left_out("delay_margin_each"):
        return
    if problem.delay > 0:
        why = (
            "with a delay, the loop closed through the other inputs is not rational; margins are then known only for a sampled "
            "controller"
        )
        draft.missing("delay_margin_each", why)
        return
    name = f"{which}, broken at one plant input with the others closed{in_the_loop(problem)}"
    with draft.part("delay_margin_each"):
        try:
            found = [margins(loop) for loop in loops]
        except InputError as error:
            draft.missing("delay_margin_each", f"linear loop {which}: {error}")
            return
        values = {EACH_INPUT[key]: [finite(getattr(one, field)) for one in found] for field, key in KEYS_OF_MARGINS.items()}
        draft.exact(values, name, LINEAR_LOOP_ONLY, rest=rest)
        peaks = [peak_gain(sensitivity(loop)).gain for loop in loops]
        draft.exact({EACH_INPUT["sensitivity_peak"]: peaks}, name, LINEAR_LOOP_ONLY, rest=rest)
        draft.loops.extend(MarginLoop(f"{which}, at input {i + 1}", loop) for i, loop in enumerate(loops))


def in_the_loop(problem: TrackingProblem) -> str:
    """The end of a loop's name, which says whether it includes the delay and the sensor lag of the case, and that it excludes the
    limits."""
    paths, sensor = problem.plant.paths, problem.sensor
    beside = f", with its delay of {problem.delay:g} s" if problem.delay > 0 else ""
    lagged = f", with its sensor's lag of {sensor.lag:g} s" if sensor is not None and sensor.lag > 0 else ""
    return beside + lagged + ("" if all(path.is_linear for path in paths) else ", without its limits")


def margins_of(problem: TrackingProblem, loop: StateSpace, which: str, notes: list[str]) -> dict[str, Any]:
    """Margins by the certificate's keys; the delay margin is the delay that the loop tolerates in addition to the existing
    delay."""
    loop = with_dynamics(problem, loop)
    try:
        found = margins(loop, problem.delay)
    except InputError as error:
        notes.append(f"linear loop {which}: {error}")
        return {}
    values = {key: finite(getattr(found, name)) for name, key in KEYS_OF_MARGINS.items()}
    unlimited = [key for key, value in values.items() if value is None]
    return values | {"unlimited": unlimited or None} | _peaks(loop, problem.delay, which, notes)


def _peaks(loop: StateSpace, delay: float, which: str, notes: list[str]) -> dict[str, float]:
    """Add max |S| and max |T|, or a finding if they are not known."""
    try:
        if delay > 0:
            S, T = delayed_peaks(loop, delay)
        else:
            S, T = (peak_gain(system(loop)).gain for system in (sensitivity, complementary_sensitivity))
    except InputError as error:
        notes.append(f"linear loop {which}: {error}")
        return {}
    return {"sensitivity_peak": S, "complementary_sensitivity_peak": T}


def add_adapting_margins(draft: Draft, problem: Problem, controller: Mrac | L1Adaptive) -> None:
    """The delay margin of the adaptive loop linearised at the constant command sup |r|."""
    command = problem.commands[0]
    assert isinstance(command, BoundedSignal)  # ``model_bounds`` rejects others
    level = command.bound
    if level == 0 or not is_needed("delay_margin_adapting"):
        return
    if is_modified(controller):
        draft.missing("delay_margin_adapting", PLAIN_LAW_ONLY)
        return
    at = f"linearised at the constant command {level:g}"
    with draft.part("delay_margin_adapting"):
        found = RestingEstimates("theta_hat", THETA, tuple(problem.parameters.tolist()), true=True)
        rest = PlaceOfRest((level,), (found,))
        add_delay_margin_adapting(draft, problem, around_equilibrium(problem, controller, level), at, rest)


def add_delay_margin_adapting(
    draft: Draft, problem: TrackingProblem, loop: StateSpace, at: str, rest: PlaceOfRest | None
) -> None:
    """Add the delay margin of the loop with its law, which was ``linearised at`` a command."""
    whole = with_dynamics(problem, loop)
    try:
        found = margins(whole, problem.delay)
    except InputError as error:
        try:
            lost = is_unstable(whole, problem.delay, NEUTRAL)
        except InputError:  # the reason why there are no margins applies here too
            lost = False
        draft.missing("delay_margin_adapting", f"{UNSTABLE_WITH_LAW}: {error}" if lost else f"linear loop {at}: {error}")
        return
    draft.loops.append(MarginLoop(f"{at}, its law included", whole, problem.delay))
    name = f"{at}, its law included{in_the_loop(problem)}"
    draft.exact({"delay_margin_adapting": finite(found.delay)}, name, LINEAR_LOOP_ONLY, rest=rest)


NEUTRAL = 1e-9
"""Real part of an eigenvalue, as a fraction of the largest one, below which a mode neither grows nor decays."""


def is_unstable(loop: StateSpace, delay: float, neutral: float = 0.0) -> bool:
    """Whether a loop is unstable with its delay; a mode whose real part is below the fraction ``neutral`` does not count."""
    values = np.linalg.eigvals(sensitivity(loop).A)
    if values.real.max() >= 0:
        return bool(values.real.max() >= neutral * np.abs(values).max())
    return margins(loop).delay <= delay


def with_dynamics(problem: TrackingProblem, loop: StateSpace) -> StateSpace:
    """The loop including the actuator, the unmodelled dynamics at the plant's input and the sensor's lag, but not the delay.

    Every signal that the controller feeds back is measured with the same lag, which is therefore in series with the loop. With an
    observer it is not in series, and the loop already contains it.
    """
    dynamics, lag = problem.plant.paths[0].dynamics, None if problem.fixed_observer is not None else problem.sensor_lag
    loop = loop if dynamics is None else series(dynamics.realise(), loop)
    return loop if lag is None else series(loop, lag)


def finite(value: float) -> float | None:
    """The value, or ``None`` if it is not finite."""
    return value if np.isfinite(value) else None
