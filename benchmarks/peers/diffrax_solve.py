"""diffrax: ``diffeqsolve`` with constant steps, and its ``vmap``.

diffrax has no classical Runge-Kutta method; its documentation says how to add one from its tableau. A solver's stages can't be
limited from outside, so the vector field limits the estimate that it is given. This is equivalent until a bound is reached, and
the check ends before that.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.loops import Case
from benchmarks.peers.equations import AMPLITUDE, FREQUENCY, STEP, WRITTEN, clip
from benchmarks.race import Contestant

jax.config.update("jax_platforms", "cpu")
jax.config.update("jax_enable_x64", True)


class ClassicalRungeKutta(diffrax.AbstractERK):
    """The classical Runge-Kutta method with four stages and order four."""

    tableau: ClassVar[diffrax.ButcherTableau] = diffrax.ButcherTableau(
        a_lower=(np.array([1 / 2]), np.array([0.0, 1 / 2]), np.array([0.0, 0.0, 1.0])),
        b_sol=np.array([1 / 6, 1 / 3, 1 / 3, 1 / 6]),
        b_error=np.array([0.0, 0.0, 0.0, 0.0]),
        c=np.array([1 / 2, 1 / 2, 1.0]),
    )
    interpolation_cls: ClassVar[Callable[..., Any]] = diffrax.ThirdOrderHermitePolynomialInterpolation.from_k

    def order(self, terms: Any) -> int:
        return 4


def contestants(case: Case, steps: int, *, quick: bool) -> list[Contestant]:
    """All members at once. XLA may use every core. Each form compiles for seconds, so ``quick`` has only one."""
    forms = list(WRITTEN[case.name].forms)
    return [_contestant(case, steps, form) for form in (forms[-1:] if quick else forms)]


def _contestant(case: Case, steps: int, form: str) -> Contestant:
    written = WRITTEN[case.name]

    def field(t: Any, y: Any, parameters: Any) -> Any:
        return written.forms[form](jnp, clip(jnp, y), AMPLITUDE * jnp.sin(FREQUENCY * t), parameters)

    def trajectory(y: Any, parameters: Any, t_end: Any) -> Any:
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            ClassicalRungeKutta(),
            t0=0.0,
            t1=t_end,
            dt0=STEP,
            y0=y,
            args=parameters,
            saveat=diffrax.SaveAt(t1=True),
            stepsize_controller=diffrax.ConstantStepSize(),
            max_steps=2 * steps,
        )
        return solution.ys[0]

    advance = jax.jit(jax.vmap(trajectory, in_axes=(0, 0, None)) if case.members > 1 else trajectory)
    states, parameters = (jnp.asarray(part.T if case.members > 1 else part[:, 0]) for part in (case.states, case.parameters))

    def run(steps: int) -> np.ndarray:
        final = np.asarray(advance(states, parameters, steps * STEP))
        return final.reshape(case.members, -1).T[: written.compared]

    return Contestant(f"diffrax{', vmap' * (case.members > 1)}, {form}", steps, run, threads=True)
