"""The registry of signals, by their names in case files. The contract tests cover all of them."""

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
"""The package's signals by their names in case files."""
