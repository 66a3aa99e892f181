"""Adaptive laws, their modifications, and the other parts that a scheme combines with a law.

``RobustMrac`` and ``NormalizedMrac`` take ``Gradient`` and the laws listed after it; ``MracOutput`` also takes ``LyapunovLaw``.
Leakage, dead zone and memory modify a law. ``AdaptiveLaw`` is the protocol of a law of your own.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
