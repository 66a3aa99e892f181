"""Many runs that answer one question: sweeps, tuning, contests, trade-offs, margins found by simulation, explorers.

A ``Budget`` bounds what they may cost.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
