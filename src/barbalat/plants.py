"""Actuators, sensors, physical parameters, plants that differ from the design, labels and known sets.

Measurements pass a sensor, faults of single samples (``Dropout``, ``Spike``, ...) and, before a sampled controller, the
``Shell``, which decides which samples are used.

``Plant``, ``OutputPlant``, the reference models and the usual known set, ``ParameterBox``, are in ``barbalat`` itself.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
