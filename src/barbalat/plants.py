"""What lies before a plant's input and behind its state, physical parameters, the truth apart from the design, names, known sets.

Behind the state are the sensor, what goes wrong with its samples (``Dropout``, ``Spike``, ...), and the ``Shell`` around a
sampled controller, which decides what of a sample is taken.

``Plant``, ``OutputPlant``, the reference models and ``ParameterBox``, the usual known set, are in ``barbalat`` itself.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
