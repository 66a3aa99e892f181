"""The step response's usual numbers, from a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barbalat import validate
from barbalat.protocols import BreakingSignal
from barbalat.validate import InputError

if TYPE_CHECKING:
    from barbalat.run.results.result import Result


def step_info(result: Result, component: int = 1) -> dict[str, float]:
    """Rise time, settling time, overshoot, ... by python-control's names, after the last jump of the command.

    component  of x, from 1; nothing to choose where y is measured

    Times [s] count from the jump; levels are those of x or y, and the last value is what counts as settled. At the recorded
    instants: their distance is the resolution. Raises InputError for a run that diverged or whose command does not jump.
    """
    validate.require_extra("control", "control", "step_info")
    import control

    state = validate.whole("component", component, least=1, most=1 if result.y is not None else result.x.shape[1]) - 1
    if result.diverged_at is not None:
        raise InputError(f"step_info needs a run to its end, but {result.name} diverged at t = {result.diverged_at:.4g} s")
    start = _last_jump(result)
    first = int(np.searchsorted(result.t, start))
    value = (result.x[:, state] if result.y is None else result.y)[first:]
    if len(value) < 2 or value[-1] == value[0]:
        raise InputError(f"step_info needs a motion after the command's jump at t = {start:.4g} s, but there is none")
    found = control.step_info(value - value[0], T=result.t[first:] - result.t[first], yfinal=value[-1] - value[0])
    levels = ("SettlingMin", "SettlingMax", "SteadyStateValue")
    info = {name: float(number + value[0] if name in levels else number) for name, number in found.items()}
    peak = {"Peak": float(value[np.argmax(np.abs(value - value[0]))])}  # python-control's is a distance, without a sign
    return validate.Named.of("figure", info | peak)


def _last_jump(result: Result) -> float:
    """When a command jumps last [s]; at 0 where it is not zero from the start."""
    jumps = [0.0] if any(float(command(np.zeros(1))[0]) != 0 for command in result.problem.commands) else []
    for command in result.problem.commands:
        if isinstance(command, BreakingSignal):
            at = command.breaks(0.0, result.simulation.t_end)
            jumps += at[command(at) != command.before(at)].tolist()
    if not jumps:
        raise InputError("step_info needs a command that jumps, such as Step(1.0)")
    return max(jumps)
