"""JAX: ``lax.scan`` over the steps, ``vmap`` over the members."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.loops import Case, command_table
from benchmarks.peers.equations import WRITTEN, rk4
from benchmarks.race import Contestant

jax.config.update("jax_platforms", "cpu")
jax.config.update("jax_enable_x64", True)


def contestants(case: Case, steps: int, *, quick: bool) -> list[Contestant]:
    """All members at once. XLA may use every core. Each form compiles for seconds, so ``quick`` has only one."""
    forms = list(WRITTEN[case.name].forms)
    return [_contestant(case, steps, form) for form in (forms[-1:] if quick else forms)]


def _contestant(case: Case, steps: int, form: str) -> Contestant:
    written, table = WRITTEN[case.name], jnp.asarray(command_table())

    def trajectory(y: Any, parameters: Any, rows: Any) -> Any:
        return jax.lax.scan(lambda y, r: (rk4(jnp, written.forms[form], y, r, parameters), None), y, rows)[0]

    advance = jax.jit(jax.vmap(trajectory, in_axes=(0, 0, None)) if case.members > 1 else trajectory)
    states, parameters = (jnp.asarray(part.T if case.members > 1 else part[:, 0]) for part in (case.states, case.parameters))

    def run(steps: int) -> np.ndarray:
        final = np.asarray(advance(states, parameters, table[:steps]))
        return final.reshape(case.members, -1).T[: written.compared]

    return Contestant(f"JAX, scan{' and vmap' * (case.members > 1)}, {form}", steps, run, threads=True)
