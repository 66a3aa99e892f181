"""The result classes of ``simulate``, ``simulate_ensemble`` and ``certify``, and ``plot``, which draws several results
together."""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
