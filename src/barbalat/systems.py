"""Linear systems, the exact margins of a loop, and L1 norms with guaranteed bounds.

``TransferFunction`` and ``input_filter`` are in ``barbalat`` itself.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
