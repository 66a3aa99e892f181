"""Linear robust designs for comparison with the adaptive schemes: mixed-sensitivity H-infinity and PI.

``hinf_feedback`` and ``pi_feedback`` return a ``LinearFeedback`` for the known part of a plant with measured state;
``mixed_sensitivity`` and ``pi_controller`` design for a transfer function. ``linear_equivalent`` returns the linear controller to
which an ``L1Output`` reduces while its estimates stay inside their bounds; ``fast_limit`` returns the limit of that controller
for fast adaptation.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
