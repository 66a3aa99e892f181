"""The protocols that your own controller implements, and what a controller knows about its problem.

A ``Controller`` holds settings. Its ``bind`` takes the ``Known`` part of a problem and returns ``Equations`` or
``SampledEquations``; each part of their state has a ``Role``. Its method ``knobs`` returns a ``TuningGrid``: the settings that a
search varies, with their ranges. ``check_controller`` tries a controller on a problem; ``barbalat.testing`` applies the package's
own tests to it.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
