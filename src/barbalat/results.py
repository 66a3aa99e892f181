"""What ``simulate``, ``simulate_ensemble`` and ``certify`` give back, and ``plot`` for results of several calls."""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
