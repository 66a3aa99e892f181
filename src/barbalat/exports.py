"""Controllers as source code for flight computers and as FMUs, and the exported code in closed loop in simulations and
flights."""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
