"""Adaptive laws, their modifications, and the other parts that a scheme combines with a law.

``RobustMrac`` and ``NormalizedMrac`` accept ``Gradient`` and the laws listed after it; ``MracOutput`` also accepts
``LyapunovLaw``. Leakage, dead zone and memory modify a law. ``AdaptiveLaw`` is the protocol for your own laws.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
