"""Extrema between nodes, of curves whose extrema are known."""

import numpy as np
import pytest

from barbalat.run.kernel.observer import Turn


def seen(t, values, smooth):
    """The largest vertex of one quantity, and the length by which its path exceeds the sum of the distances of its nodes."""
    turn, largest, more = Turn.of(np.zeros(6)), -np.inf, 0.0
    lengths = np.append(np.diff(t), 0.0)
    for value, flag, length in zip(values, smooth, lengths, strict=True):
        now = np.array([value])
        with np.errstate(invalid="ignore"):
            vertex, nearer = turn.vertex(now, flag)
        if turn.since_last > 0:
            largest, more = max(largest, float(vertex[0])), more + 2 * float(nearer[0])
        turn = Turn(now, turn.last, length, turn.since_last, flag, turn.smooth)
    return largest, more


@pytest.mark.parametrize("before", [0.01, 0.05, 0.1, 0.15, 0.19])
@pytest.mark.parametrize("way", [1, -1], ids=["begins", "ends"])
def test_a_peak_beside_the_end_of_a_piece(before, way) -> None:
    """cos(t) at nodes with a distance of 0.2, with the first or last node of a piece less than one distance from the peak."""
    t = np.arange(6) * 0.2 - before
    smooth = np.array([0.0, 1, 1, 1, 1, 1])
    values = np.cos(t)
    if way < 0:
        t, values, smooth = -t[::-1], values[::-1], smooth[::-1]
    largest, more = seen(t, values, smooth)
    assert largest == pytest.approx(1.0, abs=1e-4)
    path = (1 - values[0]) + (1 - values[-1])
    assert np.abs(np.diff(values)).sum() + more == pytest.approx(path, abs=2e-4)


def test_a_jump_is_no_turn() -> None:
    """A line falls to its end, and the next piece begins far above it. There is no extremum between nodes."""
    t = np.array([0.0, 0.1, 0.2, 0.3, 0.3, 0.4, 0.5, 0.6])
    values = np.array([0.0, -0.1, -0.2, -0.3, 5.0, 5.1, 5.2, 5.3])
    smooth = np.array([0.0, 1, 1, 0, 0, 1, 1, 1])
    assert seen(t, values, smooth) == (5.3, 0.0)
