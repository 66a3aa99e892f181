"""Integration methods: fixed-step Runge-Kutta methods as tableaux.

``Simulation`` takes one, or its name; ``SOLVERS`` maps their names in case files to them.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
