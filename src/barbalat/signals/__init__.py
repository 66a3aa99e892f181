"""Commands, disturbances and recorded data: functions of time that drive the loop.

``Signal`` says what one of your own has to be; ``SIGNALS`` has those of the package by the names that case files use.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
