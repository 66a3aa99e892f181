"""Adaptive laws, their modifications, and what schemes take beside a law.

``Gradient`` and those after it are the law of ``RobustMrac`` and ``NormalizedMrac``, ``LyapunovLaw`` is one of ``MracOutput``.
Leakage, dead zone and memory modify a law. ``AdaptiveLaw`` says what a law of your own has to be.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
