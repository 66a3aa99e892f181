"""Regressors phi(x), which the unknown parameters theta multiply in the matched uncertainty theta'phi(x).

``Plant(regressor=...)`` takes one; the default is phi(x) = x. ``Regressor`` is the protocol of a regressor of your own.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
