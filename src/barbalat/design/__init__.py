"""Linear robust designs for the same problems, with which adaptive schemes are compared: mixed-sensitivity H-infinity and PI."""

from barbalat.design.feedback import hinf_feedback, pi_controller, pi_feedback
from barbalat.design.hinf import MixedSensitivity, default_delay, delay_weight, design_model, mixed_sensitivity

__all__ = [
    "MixedSensitivity",
    "default_delay",
    "delay_weight",
    "design_model",
    "hinf_feedback",
    "mixed_sensitivity",
    "pi_controller",
    "pi_feedback",
]
