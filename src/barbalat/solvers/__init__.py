"""Integration methods: fixed-step Runge-Kutta methods as tableaux.

``Simulation`` takes a method or its name; ``SOLVERS`` maps the names in case files to the methods.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
