"""Studies of many runs that answer one question: sweeps, sensitivities, tuning, contests, trade-offs, margins, explorers.

A ``Budget`` limits their cost.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
