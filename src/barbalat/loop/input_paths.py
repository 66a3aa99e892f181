"""All inputs of a loop. Each has a path with limits or unmodelled dynamics, or None if u reaches the plant unchanged."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from barbalat.problem.actuation import InputPath
from barbalat.protocols import Value

Paths = tuple[InputPath | None, ...]
States = tuple[Any, ...]
"""The state of each path; an empty tuple if there is no path."""


def initial(paths: Paths) -> States:
    """The states of all paths at rest."""
    return tuple(() if path is None else path.initial() for path in paths)


def derivative(paths: Paths, states: States, u: Value) -> States:
    """The derivatives of the states, driven by u (m,)."""
    flat = u.reshape(-1)
    pairs = enumerate(zip(paths, states, strict=True))
    return tuple(state if path is None else path.derivative(state, flat[i]) for i, (path, state) in pairs)


def output(paths: Paths, states: States, u: Value) -> Value:
    """The outputs of all paths, in the shape of u."""
    if all(path is None for path in paths):
        return u
    flat, passed = u.reshape(-1), []
    for i, (path, state) in enumerate(zip(paths, states, strict=True)):
        passed.append((flat[i] if path is None else path.output(state, flat[i])).reshape(1))
    return np.concatenate(passed).reshape(u.shape)


def following_within(paths: Paths, time: Value) -> Paths:
    """Return the paths for a solver whose step is ``time`` [s], within which rate limiters follow their demand."""
    if all(path is None or path.rate_limit is None for path in paths):
        return paths
    return tuple(path and replace(path, following=time) for path in paths)
