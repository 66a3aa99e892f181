"""Commands, disturbances and recorded data: functions of time that drive the loop.

``Signal`` is the protocol for your own signals; ``SIGNALS`` contains the package's signals by their names in case files.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
