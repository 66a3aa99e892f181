"""The registry of the laws for the parametric model, with their names in case files. The contract tests cover all of them."""

from barbalat.adaptation.law import AdaptiveLaw as AdaptiveLaw
from barbalat.adaptation.law import Estimation as Estimation
from barbalat.adaptation.law import Rates as Rates
from barbalat.adaptation.laws.gradient import Gradient as Gradient
from barbalat.adaptation.laws.integral_cost import IntegralCost as IntegralCost
from barbalat.adaptation.laws.least_squares import LeastSquares as LeastSquares
from barbalat.adaptation.laws.least_squares import LeastSquaresBounded as LeastSquaresBounded
from barbalat.adaptation.laws.least_squares import LeastSquaresBoundedGain as LeastSquaresBoundedGain
from barbalat.adaptation.laws.least_squares import LeastSquaresForgetting as LeastSquaresForgetting
from barbalat.adaptation.laws.least_squares import LeastSquaresResetting as LeastSquaresResetting
from barbalat.adaptation.lyapunov import LyapunovLaw as LyapunovLaw

LAWS = {
    "gradient": Gradient,
    "integral-cost": IntegralCost,
    "least-squares": LeastSquares,
    "least-squares-forgetting": LeastSquaresForgetting,
    "least-squares-resetting": LeastSquaresResetting,
    "least-squares-bounded": LeastSquaresBounded,
    "least-squares-bounded-gain": LeastSquaresBoundedGain,
}
OUTPUT_LAWS = {"lyapunov": LyapunovLaw} | LAWS
"""The laws of output-feedback MRAC."""
