"""Regressors phi(x): what the unknown parameters theta multiply in the matched uncertainty theta'phi(x).

``Plant(regressor=...)`` takes one; without one phi(x) = x. ``Regressor`` says what one of your own has to be.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
