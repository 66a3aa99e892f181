"""Design, certify, simulate and deploy adaptive controllers, and find out which claims about them are true.

Names are imported when they are first used, so that ``import barbalat`` is fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from barbalat.actuation import PlantInput
    from barbalat.adaptation.dead_zone import DeadZone
    from barbalat.adaptation.epsilon_modification import EpsilonModification
    from barbalat.adaptation.fixed_sigma import FixedSigma
    from barbalat.adaptation.laws import (
        Gradient,
        IntegralCost,
        LeastSquares,
        LeastSquaresBounded,
        LeastSquaresBoundedGain,
        LeastSquaresForgetting,
        LeastSquaresResetting,
    )
    from barbalat.adaptation.learning import CompositeLearning
    from barbalat.adaptation.normalization import Normalization
    from barbalat.adaptation.switching_sigma import SwitchingSigma
    from barbalat.certify.certificate import Certificate
    from barbalat.certify.frozen import FrozenLoops, borne
    from barbalat.certify.l1 import Enclosure, l1_norm
    from barbalat.certify.margins import Margins, margins
    from barbalat.certify.modelling_error import DelayError, ScaledError
    from barbalat.certify.table import certify
    from barbalat.checking import check_numerics
    from barbalat.controllers import L1Adaptive, LinearFeedback, Mrac, NormalizedMrac, RobustMrac, Sampled
    from barbalat.controllers.output.l1 import L1Output, fast_limit, linear_equivalent
    from barbalat.controllers.output.linear import LinearOutput
    from barbalat.controllers.output.lyapunov import LyapunovLaw
    from barbalat.controllers.output.mrac import MracOutput
    from barbalat.ensemble import EnsembleResult, simulate_ensemble
    from barbalat.grid import Simulation
    from barbalat.known_set import ParameterBall, ParameterBox
    from barbalat.linear import StateSpace, TransferFunction, input_filter
    from barbalat.linear_design import hinf_feedback, pi_feedback
    from barbalat.measurement import Noise, Sensor
    from barbalat.output_problem import OutputPlant, OutputProblem, OutputReferenceModel
    from barbalat.plant import Plant, ReferenceModel
    from barbalat.problem import Problem
    from barbalat.regressors import GaussianRBF, Linear, Polynomial, Terms
    from barbalat.result import Result
    from barbalat.signals import Chirp, Constant, Recorded, Sine, Sines, Square, Step, Steps
    from barbalat.simulation import simulate
    from barbalat.solvers import EULER, HEUN, RK4
    from barbalat.study.criteria import Lost, Onset
    from barbalat.study.delay_margin import delay_margins
    from barbalat.study.tau_limit import Grown, TauStudy
    from barbalat.study.tradeoff import trade_off
    from barbalat.tracking_problem import Disturbance
    from barbalat.validate import InputError

_HOME = {
    "controllers.output.l1": ("L1Output", "fast_limit", "linear_equivalent"),
    "controllers.output.linear": ("LinearOutput",),
    "controllers.output.lyapunov": ("LyapunovLaw",),
    "controllers.output.mrac": ("MracOutput",),
    "output_problem": ("OutputPlant", "OutputProblem", "OutputReferenceModel"),
    "study.criteria": ("Lost", "Onset"),
    "study.delay_margin": ("delay_margins",),
    "study.tau_limit": ("Grown", "TauStudy"),
    "study.tradeoff": ("trade_off",),
    "actuation": ("PlantInput",),
    "adaptation.dead_zone": ("DeadZone",),
    "adaptation.epsilon_modification": ("EpsilonModification",),
    "adaptation.fixed_sigma": ("FixedSigma",),
    "adaptation.laws": (
        "Gradient",
        "IntegralCost",
        "LeastSquares",
        "LeastSquaresBounded",
        "LeastSquaresBoundedGain",
        "LeastSquaresForgetting",
        "LeastSquaresResetting",
    ),
    "adaptation.learning": ("CompositeLearning",),
    "adaptation.normalization": ("Normalization",),
    "adaptation.switching_sigma": ("SwitchingSigma",),
    "certify.frozen": ("FrozenLoops", "borne"),
    "certify.modelling_error": ("DelayError", "ScaledError"),
    "certify.certificate": ("Certificate",),
    "certify.l1": ("Enclosure", "l1_norm"),
    "certify.margins": ("Margins", "margins"),
    "checking": ("check_numerics",),
    "controllers": ("L1Adaptive", "LinearFeedback", "Mrac", "NormalizedMrac", "RobustMrac", "Sampled"),
    "ensemble": ("EnsembleResult", "simulate_ensemble"),
    "grid": ("Simulation",),
    "linear_design": ("hinf_feedback", "pi_feedback"),
    "linear": ("StateSpace", "TransferFunction", "input_filter"),
    "known_set": ("ParameterBall", "ParameterBox"),
    "measurement": ("Noise", "Sensor"),
    "plant": ("Plant", "ReferenceModel"),
    "problem": ("Problem",),
    "tracking_problem": ("Disturbance",),
    "regressors": ("GaussianRBF", "Linear", "Polynomial", "Terms"),
    "result": ("Result",),
    "signals": ("Chirp", "Constant", "Recorded", "Sine", "Sines", "Square", "Step", "Steps"),
    "simulation": ("simulate",),
    "solvers": ("EULER", "HEUN", "RK4"),
    "validate": ("InputError",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "EULER",
    "HEUN",
    "RK4",
    "Certificate",
    "Chirp",
    "CompositeLearning",
    "Constant",
    "DeadZone",
    "DelayError",
    "Disturbance",
    "Enclosure",
    "EnsembleResult",
    "EpsilonModification",
    "FixedSigma",
    "FrozenLoops",
    "GaussianRBF",
    "Gradient",
    "Grown",
    "InputError",
    "IntegralCost",
    "L1Adaptive",
    "L1Output",
    "LeastSquares",
    "LeastSquaresBounded",
    "LeastSquaresBoundedGain",
    "LeastSquaresForgetting",
    "LeastSquaresResetting",
    "Linear",
    "LinearFeedback",
    "LinearOutput",
    "Lost",
    "LyapunovLaw",
    "Margins",
    "Mrac",
    "MracOutput",
    "Noise",
    "Normalization",
    "NormalizedMrac",
    "Onset",
    "OutputPlant",
    "OutputProblem",
    "OutputReferenceModel",
    "ParameterBall",
    "ParameterBox",
    "Plant",
    "PlantInput",
    "Polynomial",
    "Problem",
    "Recorded",
    "ReferenceModel",
    "Result",
    "RobustMrac",
    "Sampled",
    "ScaledError",
    "Sensor",
    "Simulation",
    "Sine",
    "Sines",
    "Square",
    "StateSpace",
    "Step",
    "Steps",
    "SwitchingSigma",
    "TauStudy",
    "Terms",
    "TransferFunction",
    "borne",
    "certify",
    "check_numerics",
    "delay_margins",
    "fast_limit",
    "hinf_feedback",
    "input_filter",
    "l1_norm",
    "linear_equivalent",
    "margins",
    "pi_feedback",
    "simulate",
    "simulate_ensemble",
    "trade_off",
]


def __getattr__(name: str) -> Any:
    if name == "certify":  # the package itself, which can be called
        return import_module("barbalat.certify")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'barbalat' has no attribute {name!r}")
    return getattr(import_module(f"barbalat.{_MODULE_OF[name]}"), name)
