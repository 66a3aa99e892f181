"""A formula of order eight, for runs that a method of lower order damps: it takes little from what its step still resolves."""

from __future__ import annotations

from functools import cache

from barbalat.solvers.tableau import Tableau


@cache
def order_eight() -> Tableau:
    """The formula of order eight of DOP853 by SciPy's coefficients, for fixed steps.

    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.5.
    """
    from scipy.integrate import DOP853

    a, count = DOP853.A, DOP853.n_stages
    rows = tuple(tuple(map(float, a[i, :i])) for i in range(count))
    return Tableau("dop853", 8, rows, tuple(map(float, DOP853.B)), tuple(map(float, DOP853.C[:count])))
