"""The steady state of the reference model for a constant command, which shows whether k_0 is wrong."""

from __future__ import annotations

import numpy as np

from barbalat.problem.tracking import TrackingProblem
from barbalat.validate import Array

FOLLOWS_TO = 1e-3
"""A gain that is this close to 1 counts as 1, because coefficients are typed with three or four digits."""


def gains_at_rest(problem: TrackingProblem) -> Array:
    """Return the steady-state values of the model's states (n, q), or of its output (1, 1), for commands of 1, which are the
    model's gains at s = 0."""
    A, B, C = problem.model.matrices
    return np.asarray(0.0 - C @ np.linalg.solve(A, B))  # avoids a minus sign before zero in a sentence


def commanded(problem: TrackingProblem) -> list[tuple[int, list[int]]]:
    """Return the states on which commands act, each with its commands.

    A command acts on the state that is declared to follow it, or else on one that settles at it, or else on the first state that
    moves. If there are several commands, the last rule is replaced by the state that the command moves most.
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
    """Return a warning if no state settles at the command or, with output feedback, if the output does not; otherwise, and for
    several commands, ``None``."""
    gains = gains_at_rest(problem)
    if gains.shape[1] > 1 or not np.isfinite(gains).all() or (np.abs(gains - 1) <= FOLLOWS_TO).any():
        return None
    state = commanded(problem)[0][0]
    gain, moved = float(gains[state, 0]), "y_m" if problem.feedback == "output" else problem.followed_names[state]
    remedy = problem.model.remedy(gain)
    instead = "" if remedy is None else f"; for r choose {remedy}"
    return f"the reference model's {moved} settles at {gain:.4g} times a constant command r, not at r{instead}"
