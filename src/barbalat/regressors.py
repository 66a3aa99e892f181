"""Regressors phi(x), which the unknown parameters theta multiply in the matched uncertainty theta'phi(x).

Pass one as ``Plant(regressor=...)``; the default is phi(x) = x. ``Regressor`` is the protocol for your own regressors.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
