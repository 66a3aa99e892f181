"""The registry of schemes by their names in case files, one line for each scheme. The contract tests cover all of them."""

from barbalat.controllers.adrc import Adrc as Adrc
from barbalat.controllers.baseline import BaselineAlone as BaselineAlone
from barbalat.controllers.known_parameters import KnownParameters as KnownParameters
from barbalat.controllers.l1 import L1Adaptive as L1Adaptive
from barbalat.controllers.l1_piecewise import L1PiecewiseConstant as L1PiecewiseConstant
from barbalat.controllers.linear_feedback import LinearFeedback as LinearFeedback
from barbalat.controllers.mit_rule import MitRule as MitRule
from barbalat.controllers.mrac import Mrac as Mrac
from barbalat.controllers.mrac_closed_loop import MracClosedLoop as MracClosedLoop
from barbalat.controllers.mrac_direct import DirectMrac as DirectMrac
from barbalat.controllers.mrac_network import NetworkMrac as NetworkMrac
from barbalat.controllers.robust_mrac import NormalizedMrac as NormalizedMrac
from barbalat.controllers.robust_mrac import RobustMrac as RobustMrac
from barbalat.controllers.sampled import Sampled as Sampled

SCHEMES = {
    "mrac": Mrac,
    "mrac-closed-loop": MracClosedLoop,
    "mrac-direct": DirectMrac,
    "mrac-network": NetworkMrac,
    "mit-rule": MitRule,
    "l1": L1Adaptive,
    "l1-piecewise": L1PiecewiseConstant,
    "mrac-normalized": NormalizedMrac,
    "robust-mrac": RobustMrac,
    "linear": LinearFeedback,
    "adrc": Adrc,
    "known-parameters": KnownParameters,
    "baseline": BaselineAlone,
}
