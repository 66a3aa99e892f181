"""Commands, disturbances and recorded data: functions of time that drive the loop. The registry has case files' names."""

from barbalat.signals.piecewise import Square, Step, Steps
from barbalat.signals.recorded import MatFile, Recorded
from barbalat.signals.smooth import Chirp, Clock, Constant, Sine, Sines

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

__all__ = ["SIGNALS", "Chirp", "Clock", "Constant", "MatFile", "Recorded", "Sine", "Sines", "Square", "Step", "Steps"]
