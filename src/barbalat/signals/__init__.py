"""Commands, disturbances and recorded data: functions of time that drive the loop. The registry has case files' names."""

from barbalat.signals.piecewise import Square as Square
from barbalat.signals.piecewise import Step as Step
from barbalat.signals.piecewise import Steps as Steps
from barbalat.signals.recorded import MatFile as MatFile
from barbalat.signals.recorded import Recorded as Recorded
from barbalat.signals.smooth import Chirp as Chirp
from barbalat.signals.smooth import Clock as Clock
from barbalat.signals.smooth import Constant as Constant
from barbalat.signals.smooth import Sine as Sine
from barbalat.signals.smooth import Sines as Sines

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
