"""Linear robust design for the same problems: mixed-sensitivity H-infinity and PI, the yardsticks beside the adaptive schemes."""

from barbalat.linear_design.feedback import hinf_feedback, pi_feedback
from barbalat.linear_design.hinf import MixedSensitivity, mixed_sensitivity
from barbalat.linear_design.pi import pi_controller
from barbalat.linear_design.uncertainty import default_delay, delay_weight, design_model

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
