"""Numba: the operation list as a Python loop over scalars, compiled by ``njit``."""

from __future__ import annotations

import importlib.util

import numpy as np

from benchmarks import evaluate
from benchmarks.loops import Case, command_table
from benchmarks.race import Contestant


def missing() -> str | None:
    return None if importlib.util.find_spec("numba") else "numba is not installed"


def contestants(case: Case, steps: int) -> list[Contestant]:
    """One trajectory, with and without ``fastmath``."""
    import numba

    source = _source(case)
    result = []
    for fastmath in (False, True):
        namespace = {"inf": np.inf}
        exec(compile(source, "<operation list>", "exec"), namespace)
        loop = numba.njit(fastmath=fastmath)(namespace["loop"])

        def run(steps: int, loop: object = loop) -> np.ndarray:
            state = case.states[:, 0].copy()
            loop(steps, state, command_table())  # type: ignore[operator]
            return state[:, None]

        result.append(Contestant("Numba" + ", fastmath" * fastmath, steps, run))
    return result


def _source(case: Case) -> str:
    program, size = case.as_read(), len(case.states)
    names = {0: "x{}", 3: "table[k, {}]"}
    body = evaluate.statements(program, lambda argument, component: names[argument].format(component))
    everything = ", ".join(f"x{i}" for i in range(size))
    following = ", ".join(f"t{i}" for i in program.outputs[0])
    functions = ["minimum = lambda a, b: b if a > b else a", "maximum = lambda a, b: b if a < b else a"]
    functions += ["where = lambda c, a, b: a if c else b", "invert = lambda c: not c"]
    lines = [*functions, f"{everything} = state", "for k in range(steps):"]
    lines += ["    " + line for line in [*body, f"{everything} = {following}"]]
    lines += [f"state[{i}] = x{i}" for i in range(size)]
    return "\n    ".join(["def loop(steps, state, table):", *lines])
