"""JAX on the CPU: ``lax.scan`` over the steps, ``vmap`` over the members."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable
from typing import Any

import numpy as np

from barbalat import RK4
from benchmarks import evaluate
from benchmarks.loops import STEP, Case, command_table
from benchmarks.race import Contestant


def missing() -> str | None:
    return None if importlib.util.find_spec("jax") else "jax is not installed"


class _Traced(np.lib.mixins.NDArrayOperatorsMixin):
    """A JAX array that NumPy's functions accept, so that our equations trace in JAX without a second copy of them."""

    def __init__(self, array: Any) -> None:
        self.array = array

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any) -> _Traced:
        assert method == "__call__"
        return self.__array_function__(ufunc, (), inputs, {})

    def __array_function__(self, function: Any, types: Any, arguments: Any, keywords: Any) -> _Traced:
        import jax.numpy as jnp

        return _Traced(getattr(jnp, function.__name__)(*_raw(arguments), **keywords))

    def __getitem__(self, index: Any) -> _Traced:
        return _Traced(self.array[index])

    def __len__(self) -> int:
        return len(self.array)

    def reshape(self, *shape: Any) -> _Traced:
        return _Traced(self.array.reshape(*shape))


def _raw(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return type(value)(_raw(part) for part in value)
    return value.array if isinstance(value, _Traced) else value


def equations(case: Case, steps: int) -> Contestant:
    """What a user of JAX writes: the equations on arrays."""
    return Contestant("JAX", steps, _runner(case, _equations_step(case)))


def operation_list(case: Case, steps: int) -> Contestant:
    """What nobody writes by hand: our operation list on scalars, which XLA can fuse into few loops."""
    return Contestant("JAX on our operation list", steps, _runner(case, _list_step(case)))


def _equations_step(case: Case) -> Callable[[Any, Any, Any], Any]:
    def step(state: Any, parameters: Any, row: Any) -> Any:
        loop = case.loop_of(_Traced(parameters))
        signals = {node: _Traced(row[i : i + 1]) for i, node in enumerate(RK4.nodes)}
        return RK4.advance(loop.derivative, loop.limit, _Traced(state), signals, STEP).array

    return step


def _list_step(case: Case) -> Callable[[Any, Any, Any], Any]:
    import jax.numpy as jnp

    functions = {"minimum": jnp.minimum, "maximum": jnp.maximum, "where": jnp.where, "invert": jnp.logical_not, "sqrt": jnp.sqrt}
    step = evaluate.step(case.as_read(), functions)
    return lambda state, parameters, row: jnp.stack(step(state, parameters, row))


def _runner(case: Case, step: Callable[[Any, Any, Any], Any]) -> Callable[[int], np.ndarray]:
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    import jax

    jax.config.update("jax_enable_x64", True)

    def trajectory(state: Any, parameters: Any, table: Any) -> Any:
        return jax.lax.scan(lambda carry, row: (step(carry, parameters, row), None), state, table)[0]

    single = case.members == 1
    compiled = jax.jit(trajectory if single else jax.vmap(trajectory, in_axes=(1, 1, None), out_axes=1))
    states, parameters = (part[:, 0] if single else part for part in (case.states, case.parameters))

    def run(steps: int) -> np.ndarray:
        return np.asarray(compiled(states, parameters, command_table()[:steps])).reshape(case.states.shape)

    return run
