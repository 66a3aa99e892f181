"""A page's estimate of Theorem 1's condition on the filter, from a simulated impulse response of W_b (1 - C). It is not a
certificate."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from barbalat.cases.build import Case
from barbalat.controllers.l1 import Equations
from barbalat.explorer.encoded import doubles
from barbalat.explorer.sliders import Slider
from barbalat.loop.packing import column, symbols
from barbalat.lowering.operations import read
from barbalat.lowering.shape import LoopShape
from barbalat.lowering.wasm.loop import loop as module_of
from barbalat.open_numbers.kernel_numbers import Numbers
from barbalat.open_numbers.numbers import At
from barbalat.open_numbers.probe import Rows, effects_of
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Value
from barbalat.validate import Array, InputError

TAYLOR_TERMS = 4
"""Number of terms of e^(hA) in a step, as for RK4 on a linear system."""


@dataclass(frozen=True, eq=False)
class Filtered:
    """The numbers of a module for one controller: A_m, b, A, B and C of the filter, and the bounds of the known set, in this
    order."""

    index: int

    def parts(self, case: Case) -> list[Array] | None:
        """Return these arrays, or None if the condition has no meaning, as for a different scheme or plant or without projection
        onto a box."""
        problem = case.problem
        if not isinstance(problem, Problem):
            return None
        equations = case.controllers[self.index].bind(problem.known)
        # Theorem 1 is about C(s) and x_hat of this scheme; only a box has bounds as separate numbers
        if not isinstance(equations, Equations) or not isinstance(known_set := equations.estimate_set, ParameterBox):
            return None
        plain = problem.known.inputs == 1 and not problem.known.matched.gain_unknown
        C = equations.C
        return [problem.known.A_m, problem.known.b, C.A, C.B, C.C, known_set.lower, known_set.upper] if plain else None

    def read(self, cases: Sequence[Case]) -> Numbers:
        """Read the numbers of several cases.

        Raises InputError if a case has no such numbers.
        """
        columns = []
        for case in cases:
            parts = self.parts(case)
            if parts is None:
                raise InputError("the condition on C(s) has no meaning here")
            columns.append(np.concatenate([part.reshape(-1) for part in parts]))
        if len({len(one) for one in columns}) > 1:
            raise InputError("the filters have different orders")
        none = np.zeros((0, len(cases)))
        return Numbers(np.column_stack(columns), none, None, None, np.zeros(len(cases)), None)


def condition_of(case: Case, index: int, sliders: Sequence[Slider], at: At) -> dict[str, Any] | None:
    """Return the condition for a page's JSON. It names the sliders whose effect cannot be reproduced; if such a slider is moved,
    there is no estimate."""
    target = Filtered(index)
    parts = target.parts(case)
    if parts is None:
        return None
    effects, lost, rows = {}, [], dict[int, Rows]()
    for j, slider in enumerate(sliders):
        found = effects_of(slider.number, [target], [set()], at)
        beside = set().union(*(moved for k, moved in rows.items() if not slider.excludes(sliders[k])))
        if found is None or len(found[0].values) != len(slider.number.values) or found[1][0].rows & beside:
            lost.append(j)
        elif not found[1][0].nothing:
            (effect,) = found[1]
            rows[j] = effect.rows
            effects[j] = {"p": effect.parameters.tolist(), "table": None if effect.table is None else doubles(effect.table)}
    return {
        "module": base64.b64encode(_module([part.shape for part in parts])).decode(),
        "parameters": doubles(target.read([case]).parameters[:, 0]), "effects": effects, "lost": lost,
        "states": len(parts[1]), "filter": len(parts[3]),
    }  # fmt: skip


def _module(shapes: Sequence[tuple[int, ...]]) -> bytes:
    """Return a module that integrates x' = A_m x - b C z, z' = A z. Its accumulators are the integrals of |x_i|, and its last
    parameter is the step [s]."""
    import casadi as ca

    sizes = [int(np.prod(shape)) for shape in shapes]
    (n,), (m,) = shapes[1], shapes[3]
    parameter_column, parameters = symbols("parameters", sum(sizes) + 1)
    state_column, state = symbols("state", n + m)
    sum_column, sums = symbols("sums", n)
    ends = np.cumsum(sizes)
    A_m, b, A, _, C, *_ = (
        parameters[end - size : end].reshape(shape) for end, size, shape in zip(ends, sizes, shapes, strict=True)
    )
    slope = partial(_slope, A_m, b, A, C, n)
    following, term = state, state
    for k in range(1, TAYLOR_TERMS + 1):
        term = slope(term) * (parameters[-1] / k)
        following = following + term
    integrals = sums + (np.abs(state[:n]) + np.abs(following[:n])) * (parameters[-1] / 2)
    nothing = ca.SX(0, 1)
    inputs = [state_column, sum_column, parameter_column, nothing, nothing, nothing]
    traced = ca.Function("impulse", inputs, [column(following), column(integrals), nothing], {"cse": True})
    return module_of(read(traced), LoopShape(n + m, n, sum(sizes) + 1, 0), (0.0,) * n)


def _slope(A_m: Value, b: Value, A: Value, C: Value, n: int, state: Value) -> Value:
    x, z = state[:n], state[n:]
    return np.concatenate([A_m @ x - b * (C @ z), A @ z])
