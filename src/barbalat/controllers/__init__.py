"""The registry: one line for each scheme, by the name that case files use. The contract tests run over it."""

from barbalat.controllers.known_parameters import KnownParameters
from barbalat.controllers.l1 import L1Adaptive
from barbalat.controllers.linear_feedback import LinearFeedback
from barbalat.controllers.mrac import Mrac
from barbalat.controllers.mrac_closed_loop import MracClosedLoop
from barbalat.controllers.robust_mrac import NormalizedMrac, RobustMrac
from barbalat.controllers.sampled import Sampled

SCHEMES = {
    "mrac": Mrac,
    "mrac-closed-loop": MracClosedLoop,
    "l1": L1Adaptive,
    "mrac-normalized": NormalizedMrac,
    "robust-mrac": RobustMrac,
    "linear": LinearFeedback,
}

__all__ = [
    "SCHEMES",
    "KnownParameters",
    "L1Adaptive",
    "LinearFeedback",
    "Mrac",
    "MracClosedLoop",
    "NormalizedMrac",
    "RobustMrac",
    "Sampled",
]
