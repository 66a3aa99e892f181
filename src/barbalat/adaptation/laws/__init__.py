"""The registry of the laws on the parametric model, by the names of case files. The contract tests run over it."""

from barbalat.adaptation.law import AdaptiveLaw, Estimation, Rates
from barbalat.adaptation.laws.bounded_covariance import LeastSquaresBounded
from barbalat.adaptation.laws.bounded_gain import LeastSquaresBoundedGain
from barbalat.adaptation.laws.forgetting import LeastSquaresForgetting
from barbalat.adaptation.laws.gradient import Gradient
from barbalat.adaptation.laws.integral_cost import IntegralCost
from barbalat.adaptation.laws.least_squares import LeastSquares
from barbalat.adaptation.laws.resetting import LeastSquaresResetting
from barbalat.adaptation.output_lyapunov import LyapunovLaw

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

__all__ = [
    "LAWS", "OUTPUT_LAWS", "AdaptiveLaw", "Estimation", "Gradient", "IntegralCost", "LeastSquares", "LeastSquaresBounded",
    "LeastSquaresBoundedGain", "LeastSquaresForgetting", "LeastSquaresResetting", "LyapunovLaw", "Rates",
]  # fmt: skip
