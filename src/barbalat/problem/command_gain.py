"""The steady state of the reference model for a constant command, which shows whether k_0 was chosen wrongly."""

from __future__ import annotations

import numpy as np

from barbalat.problem.tracking import TrackingProblem
from barbalat.validate import Array

FOLLOWS_TO = 1e-3
"""A gain this close to 1 counts as 1, because coefficients are typed with three or four digits."""


def gains_at_rest(problem: TrackingProblem) -> Array:
    """The steady-state values of the model's states, or of its output, for commands of 1, (n, q) or (1, 1): the model's gain
    at s = 0."""
    A, B, C = problem.model.matrices
    return np.asarray(0.0 - C @ np.linalg.solve(A, B))  # avoids a minus sign before a zero in a sentence


def commanded(problem: TrackingProblem) -> list[tuple[int, list[int]]]:
    """The states that commands act on, each with its commands: the state that is declared to follow the command, or else one that
    settles at it, or else the first that moves.

    With several commands, each without such a state is assigned to the state that it moves most.
    """
    gains = gains_at_rest(problem)
    scale = np.abs(gains).max(initial=0.0)
    found: dict[int, list[int]] = {}
    declared = dict(enumerate(problem.declared_followers))
    for k, column in enumerate(gains.T):
        following = np.flatnonzero(np.abs(column - 1) <= FOLLOWS_TO)
        first = np.flatnonzero(np.abs(column) > 1e-9 * scale)  # smaller ones are rounding errors
        moving = first if gains.shape[1] == 1 else [np.abs(column).argmax()]
        own = declared.get(k)
        state = int(next(iter([*following, *moving]), 0)) if own is None else own
        found.setdefault(state, []).append(k)
    return sorted(found.items())


def command_warning(problem: TrackingProblem) -> str | None:
    """A warning if no state, or not the output, settles at the command; otherwise ``None``, as for several commands."""
    gains = gains_at_rest(problem)
    if gains.shape[1] > 1 or not np.isfinite(gains).all() or (np.abs(gains - 1) <= FOLLOWS_TO).any():
        return None
    state = commanded(problem)[0][0]
    gain, moved = float(gains[state, 0]), "y_m" if problem.feedback == "output" else problem.followed_names[state]
    remedy = problem.model.remedy(gain)
    instead = "" if remedy is None else f"; for r choose {remedy}"
    return f"the reference model's {moved} settles at {gain:.4g} times a constant command r, not at r{instead}"
