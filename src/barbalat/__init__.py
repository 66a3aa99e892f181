"""Design, certify, simulate and deploy adaptive controllers, and find out which claims about them are true.

Names are imported when they are first used, so that ``import barbalat`` is fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from barbalat.actuation import PlantInput
    from barbalat.adaptation.laws import Gradient, LeastSquares
    from barbalat.adaptation.normalization import Normalization
    from barbalat.checking import check_numerics
    from barbalat.controllers import L1Adaptive, Mrac, NormalizedMrac, RobustMrac, Sampled
    from barbalat.ensemble import EnsembleResult, simulate_ensemble
    from barbalat.grid import Simulation
    from barbalat.linear import TransferFunction, input_filter
    from barbalat.measurement import Noise, Sensor
    from barbalat.problem import Disturbance, ParameterBox, Plant, Problem, ReferenceModel
    from barbalat.result import Result
    from barbalat.signals import Chirp, Constant, Recorded, Sine, Sines, Square, Step, Steps
    from barbalat.simulation import simulate
    from barbalat.solvers import EULER, HEUN, RK4
    from barbalat.validate import InputError

_HOME = {
    "actuation": ("PlantInput",),
    "adaptation.laws": ("Gradient", "LeastSquares"),
    "adaptation.normalization": ("Normalization",),
    "checking": ("check_numerics",),
    "controllers": ("L1Adaptive", "Mrac", "NormalizedMrac", "RobustMrac", "Sampled"),
    "ensemble": ("EnsembleResult", "simulate_ensemble"),
    "grid": ("Simulation",),
    "linear": ("TransferFunction", "input_filter"),
    "measurement": ("Noise", "Sensor"),
    "problem": ("Disturbance", "ParameterBox", "Plant", "Problem", "ReferenceModel"),
    "result": ("Result",),
    "signals": ("Chirp", "Constant", "Recorded", "Sine", "Sines", "Square", "Step", "Steps"),
    "simulation": ("simulate",),
    "solvers": ("EULER", "HEUN", "RK4"),
    "validate": ("InputError",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "EULER", "HEUN", "RK4", "Chirp", "Constant", "Disturbance", "EnsembleResult", "Gradient", "InputError", "L1Adaptive",
    "LeastSquares", "Mrac", "Noise", "Normalization", "NormalizedMrac", "ParameterBox", "Plant", "PlantInput", "Problem",
    "Recorded", "ReferenceModel", "Result", "RobustMrac", "Sampled", "Sensor", "Simulation", "Sine", "Sines", "Square", "Step",
    "Steps", "TransferFunction", "check_numerics", "input_filter", "simulate", "simulate_ensemble",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'barbalat' has no attribute {name!r}")
    return getattr(import_module(f"barbalat.{_MODULE_OF[name]}"), name)
