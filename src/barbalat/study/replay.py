"""Replays a recorded flight through the estimator of a scheme, to find what it would have estimated while a different controller
was in control."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from barbalat import validate
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.true_values import estimate_names
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.validate import Array, InputError

CLOCK = 1e-3
"""Admissible relative deviation of the time between two samples from the sample time."""


@dataclass(frozen=True, eq=False)
class Replay:
    """times (N,) are in [s], and theta_hat (N, p) is taken after each sample. proposed (N, m) is the control that it would have
    applied, flown (N, m) the recorded control, and names (p,) are those of the estimates without a hat."""

    times: Array
    theta_hat: Array
    proposed: Array
    flown: Array
    names: tuple[str, ...]

    @property
    def tail(self) -> Array:
        """The estimates of the last quarter of the recording."""
        return self.theta_hat[-max(1, len(self.times) // 4) :]

    @property
    def apart(self) -> float:
        """The root mean square of the difference between the proposed and the flown control."""
        return float(np.sqrt(np.mean((self.proposed - self.flown) ** 2)))


def replay_case(
    problem: Problem, controllers: Sequence[Controller], times: Array, measured: Array, inputs: Array, commands: Array
) -> dict[str, Replay]:
    """Return the replay for each sampled controller of a case that estimates something, keyed by name; raises InputError if no
    controller does."""
    validate.instance("problem", problem, Problem)
    loops = {one: ClosedLoop.of(problem.nominal, one) for one in controllers}
    able = [one for one, loop in loops.items() if loop.sampled and loop.parameters]
    if not able:
        raise InputError("a replay needs a sampled controller that estimates something, but the case has none: give sample_time")
    found = {}
    for one in able:
        try:
            found[one.name] = replay(problem, one, times, measured, inputs, commands)
        except InputError as error:
            raise InputError(f"{one.name}: {error}") from None
    return found


def replay(problem: Problem, controller: Controller, times: Array, measured: Array, inputs: Array, commands: Array) -> Replay:
    """Replay a recording through a sampled controller. At each sample the recorded control replaces the controller's.

    The estimator, model and filters run as in flight; the controller's proposed control is only recorded. The model starts at the
    first measurement. If that was noisy, this is not exactly its initial state in flight.

    times     (N,) [s], spaced by the controller's sample time
    measured  (N, n), the states of the plant; with an observer (N, p), its measurements
    inputs    (N, m), the control that was applied at each sample and held until the next
    commands  (N, q)

    Raises InputError for a continuous controller, and for wrong times or sizes.
    """
    validate.instance("problem", problem, Problem)
    times = validate.vector("times", times)
    N, plant = len(times), problem.plant
    y = validate.array("measured", measured, (N, problem.measured))
    u = validate.array("inputs", inputs, (N, plant.inputs))
    r = validate.array("commands", commands, (N, len(problem.commands)))
    start = y[0] if problem.fixed_observer is None else problem.fixed_observer.from_measured(y[0])
    own = replace(problem.nominal, plant=replace(plant, x0=start), truth=None)
    loop = ClosedLoop.of(own, controller)
    computer, T = loop.computer, loop.sample_time
    if computer is None or T is None:
        raise InputError(f"a replay needs a sampled controller, but {controller.name} is continuous: give it a sample_time")
    wrong = np.flatnonzero(np.abs(np.diff(times) - T) > CLOCK * T)
    if len(wrong):
        i = int(wrong[0])
        raise InputError.of(
            "times",
            f"must be one sample time of {T:g} s apart, but sample {i + 2} comes {times[i + 1] - times[i]:g} s after the last",
        )
    acting, estimates, proposed = computer.initial(loop.at_first), [], []
    for k in range(N):
        if k:
            flown = u[k - 1].reshape(np.shape(acting.held.u))
            acting = acting._replace(held=acting.held._replace(u=flown))
        command = r[k, 0] if loop.commands is None else r[k]
        beside = [] if loop.external is None else computer.external_control(acting.held, y[k], r[k])
        acting = computer.act(acting, np.concatenate([y[k], beside]), command)
        estimates.append(np.asarray(loop.theta_hat(acting.controller), dtype=float))
        proposed.append(np.asarray(acting.held.u, dtype=float).reshape(-1))
    return Replay(times, np.array(estimates), np.array(proposed), u, estimate_names(own, loop))
