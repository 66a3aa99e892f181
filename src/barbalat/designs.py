"""Linear robust designs, the yardsticks beside the adaptive schemes: mixed-sensitivity H-infinity and PI.

``hinf_feedback`` and ``pi_feedback`` return a ``LinearFeedback`` for what is known of a plant whose state is measured;
``mixed_sensitivity`` and ``pi_controller`` design for a transfer function. ``linear_equivalent`` and ``fast_limit`` return the
linear controller that an ``L1Output`` is inside its bounds, and its limit for fast adaptation.
"""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
