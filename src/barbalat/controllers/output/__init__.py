"""The registry of schemes that measure only y, by their names in case files, one line for each scheme."""

from barbalat.controllers.output.l1 import L1Output as L1Output
from barbalat.controllers.output.l1_piecewise import L1OutputPiecewiseConstant as L1OutputPiecewiseConstant
from barbalat.controllers.output.linear import LinearOutput as LinearOutput
from barbalat.controllers.output.mrac import MracOutput as MracOutput

OUTPUT_SCHEMES = {
    "mrac-output": MracOutput,
    "l1-output": L1Output,
    "l1-output-piecewise": L1OutputPiecewiseConstant,
    "linear": LinearOutput,
}
