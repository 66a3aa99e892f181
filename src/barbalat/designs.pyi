from .controllers.output.l1 import fast_limit as fast_limit
from .controllers.output.l1 import linear_equivalent as linear_equivalent
from .design.feedback import hinf_feedback as hinf_feedback
from .design.feedback import pi_controller as pi_controller
from .design.feedback import pi_feedback as pi_feedback
from .design.hinf import MixedSensitivity as MixedSensitivity
from .design.hinf import delay_weight as delay_weight
from .design.hinf import mixed_sensitivity as mixed_sensitivity
