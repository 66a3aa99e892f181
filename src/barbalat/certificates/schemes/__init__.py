"""The registry: the file that has a scheme's certificate and its column of Table 1, by the class of the controller."""

from types import ModuleType

from barbalat.certificates.schemes import l1, linear_feedback, mrac, robust_mrac
from barbalat.certificates.schemes.output import l1 as output_l1
from barbalat.certificates.schemes.output import linear as output_linear
from barbalat.certificates.schemes.output import mrac as output_mrac
from barbalat.controllers import L1Adaptive, LinearFeedback, Mrac, NormalizedMrac, RobustMrac
from barbalat.controllers.output import L1Output, LinearOutput, MracOutput

SCHEMES: dict[type, ModuleType] = {
    Mrac: mrac,
    L1Adaptive: l1,
    NormalizedMrac: robust_mrac,
    RobustMrac: robust_mrac,
    LinearFeedback: linear_feedback,
    MracOutput: output_mrac,
    L1Output: output_l1,
    LinearOutput: output_linear,
}
"""Each has certificate(problem, controller, simulation) and column(problem, controller, values)."""
