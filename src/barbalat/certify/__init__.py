"""Conditions, bounds, norms, limits of the numerics and margins: computed before anything is simulated.

The package can be called: ``barbalat.certify(problem, controllers, simulation)`` gives the certificates.
"""

import sys
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from barbalat.certify.certificate import Certificate
    from barbalat.grid import Simulation
    from barbalat.protocols import Controller
    from barbalat.tracking_problem import TrackingProblem


class _Callable(ModuleType):
    """Importing any module of this package makes the name ``barbalat.certify`` the package: the verb must be the same object."""

    def __call__(
        self, problem: "TrackingProblem", controllers: "Sequence[Controller]", simulation: "Simulation"
    ) -> "dict[str, Certificate]":
        """Certificates by the controllers' names; nothing is simulated, the solver and its step are what is judged.

        Raises InputError for a controller of which no certificate is known, or that does not fit the problem.
        """
        from barbalat.certify.table import certify

        return certify(problem, tuple(controllers), simulation)


sys.modules[__name__].__class__ = _Callable
