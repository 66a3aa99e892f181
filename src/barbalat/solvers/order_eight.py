"""DOP853: a formula of order eight for fixed steps; with its error estimate and dense output, also for variable steps.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, sections II.5 and II.6; the coefficients are SciPy's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from barbalat.solvers.tableau import Tableau

Rows = tuple[tuple[float, ...], ...]


@cache
def order_eight() -> Tableau:
    """The formula of order eight, for oscillations that a method of lower order would damp: it hardly damps oscillations that its
    step resolves."""
    from scipy.integrate import DOP853

    a, count = DOP853.A, DOP853.n_stages
    rows = tuple(tuple(map(float, a[i, :i])) for i in range(count))
    return Tableau("dop853", 8, rows, tuple(map(float, DOP853.B)), tuple(map(float, DOP853.C[:count])))


@dataclass(frozen=True)
class Embedded:
    """The error estimate and the dense output of the formula. Stage 13 is the slope at the end of the step; the dense output
    needs three further stages.

    error_3, error_5  (13,) weights of the slopes in the errors of two lower orders, from which the estimate is made
    more_a, more_c    rows of the three further stages, and their positions in the step
    dense             (4, 16) weights of the slopes in the last four of the interpolating polynomial's seven coefficients
    """

    error_3: tuple[float, ...]
    error_5: tuple[float, ...]
    more_a: Rows
    more_c: tuple[float, ...]
    dense: Rows


@cache
def embedded() -> Embedded:
    """Error estimate and dense output of order seven of ``order_eight``."""
    from scipy.integrate import DOP853

    def numbers(row: object) -> tuple[float, ...]:
        return tuple(map(float, row))  # type: ignore[call-overload]

    return Embedded(
        error_3=numbers(DOP853.E3),
        error_5=numbers(DOP853.E5),
        more_a=tuple(numbers(row) for row in DOP853.A_EXTRA),
        more_c=numbers(DOP853.C_EXTRA),
        dense=tuple(numbers(row) for row in DOP853.D),
    )
