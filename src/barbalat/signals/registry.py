"""The registry of signals, by the names that case files use. The contract tests run over it."""

from barbalat.signals.piecewise import Square, Step, Steps
from barbalat.signals.recorded import MatFile, Recorded
from barbalat.signals.smooth import Chirp, Constant, Sine, Sines

SIGNALS = {
    "constant": Constant,
    "step": Step,
    "steps": Steps,
    "sine": Sine,
    "sines": Sines,
    "square": Square,
    "chirp": Chirp,
    "csv": Recorded,
    "mat": MatFile,
}
"""The signals of the package by the names that case files use."""
