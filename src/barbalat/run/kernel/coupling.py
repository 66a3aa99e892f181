"""How fast a loop's modes are, as a number that costs a few operations a step: it tells where a spectrum is worth its price."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import continuous_twin
from barbalat.loop.packing import column
from barbalat.protocols import Value
from barbalat.run.kernel.metrics import DIVERGENCE_LIMIT, divergence_measure

if TYPE_CHECKING:
    import casadi as ca


def coupling_function(loop: ClosedLoop, step: ca.Function, dt: Value = None, parameters: ca.SX | None = None) -> ca.Function:
    """|sum of J_ij J_ji over i != j| + sum of J_ii^2, less what is constant of it; J is the Jacobian of the right-hand side.

    Without the bars that is the sum of the squares of the eigenvalues, tr J^2; for the frozen oscillator of adaptation it is
    2 omega_a^2. The arguments are those of ``step``, see ``step_function``; ``dt`` [s] is its length, ``parameters`` the
    symbols in the loop. Minus infinity where the
    run has diverged.
    """
    import casadi as ca

    given = [ca.SX.sym(step.name_in(i), step.nnz_in(i)) for i in range(step.n_in())]
    if parameters is not None:
        given[2] = parameters
    state, table_row, noise = (ca.array(given[i]).reshape(-1) for i in (0, 3, 5))
    # of the step's start
    signals = np.concatenate([table_row[: loop.signals.timed], noise, np.zeros(loop.signals.delayed)])
    twin = continuous_twin(loop).following_within(dt)
    slope: Value = column(twin.derivative(state[: twin.size], signals))
    own, crossed = _cycles(ca.jacobian(slope, given[0][: twin.size]))
    quantity = ca.array(own + ca.fabs(crossed)).reshape(-1)
    measure = divergence_measure(twin, twin.outputs(state[: twin.size], signals), state[: twin.size])
    watched = np.where(measure <= DIVERGENCE_LIMIT, quantity, -np.inf)
    return ca.Function("coupling", given, [column(watched)], {"cse": True})


def _cycles(jacobian: ca.SX) -> tuple[ca.SX, ca.SX]:
    """sum of J_ii^2 and sum of J_ij J_ji, i != j, without the terms that are constant."""
    import casadi as ca

    own, crossed = ca.SX(0), ca.SX(0)
    places = set(zip(*jacobian.sparsity().get_triplet(), strict=True))
    for i, j in sorted(places):
        if i > j or (j, i) not in places:
            continue
        product = jacobian[i, j] * jacobian[j, i]
        if product.is_constant():
            continue
        if i == j:
            own += product
        else:
            crossed += 2 * product
    return own, crossed
