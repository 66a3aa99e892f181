"""What a controller of your own has to be, and what it is told of a problem.

A ``Controller`` holds settings. Its ``bind`` takes what is ``Known`` and returns ``Equations`` or ``SampledEquations``, whose
state's parts each have a ``Role``. Its ``knobs`` return a ``TuningGrid``: which settings are tuned, and how far.
``check_controller`` tries a controller on a problem; ``barbalat.testing`` holds it to the tests of the package.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
