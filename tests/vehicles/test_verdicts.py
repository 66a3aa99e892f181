"""The judge applied to flights: artificial records that follow the command, or oscillate between the limits."""

import numpy as np
import pytest

from barbalat.judge.verdict import Class
from barbalat.vehicles.verdicts import Followed, said_of, verdict_of

T = np.arange(0.0, 40.0, 0.01)


def seen(y, u, *, t=T, limit=1.0):
    """A flight whose command is a slow sine, with this response and this control."""
    command, y, u = np.sin(0.3 * t)[:, None], y[:, None], u[:, None]
    limited, limits = np.clip(u, -limit, limit), np.array([[-limit], [limit]])
    return Followed(("q",), ("[deg/s]",), command + y, command, u, limited, limits, command)


def test_a_control_that_goes_from_limit_to_limit_is_suspected():
    """The flight oscillates at 5 rad/s with an error within the band and has 50/pi reversals in the tail of 10 s."""
    verdict = verdict_of(seen(0.02 * np.sin(5 * T), 2.0 * np.sin(5 * T)), T, 40.0, "")
    assert verdict.kind is Class.FOLLOWS and verdict.cycle is None
    assert verdict.suspect in {f"swings from limit to limit in the tail, {n} times" for n in (15, 16)}
    assert verdict.error == pytest.approx(0.02, rel=1e-3)
    assert verdict.at_limit[0] == pytest.approx(2 / 3, abs=0.01)  # 2 |sin| is above 1 for two thirds of the time


def test_what_the_command_explains_is_not_suspected():
    verdict = verdict_of(seen(0.2 + 0 * T, 0.8 * np.sin(0.3 * T)), T, 40.0, "")
    assert (verdict.kind, verdict.suspect) == (Class.OFF, "")
    assert verdict.error == pytest.approx(0.2)


@pytest.mark.parametrize("count", [3500, 1000])
def test_lost_is_what_the_vehicle_calls_so_and_nothing_else(count):
    t = T[:count]
    far = verdict_of(seen(1e4 * (t > 5), 0 * t, t=t), t, 40.0, "")
    lost = verdict_of(seen(0.01 * t, 0 * t, t=t), t, 40.0, "it capsized")
    assert (lost.kind, lost.lost_at) == (Class.LOST, pytest.approx(t[-1]))
    assert far.kind is Class.OFF
    assert said_of([far, lost]).startswith("is off in 1, is lost in 1 of 2 flights")
