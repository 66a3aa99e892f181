"""Commands, disturbances and recorded data: functions of time that drive the loop."""

from barbalat.signals.piecewise import Square, Step, Steps
from barbalat.signals.recorded import Recorded
from barbalat.signals.smooth import Chirp, Clock, Constant, Sine, Sines

__all__ = ["Chirp", "Clock", "Constant", "Recorded", "Sine", "Sines", "Square", "Step", "Steps"]
