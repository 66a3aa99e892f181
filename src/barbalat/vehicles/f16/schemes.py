"""The schemes that fly an axis of the F-16, and their parameters, which were found by one rule on the linearised aircraft."""

from __future__ import annotations

from barbalat.controllers import KnownParameters, Mrac, Sampled
from barbalat.controllers.windup import ModifiedError
from barbalat.design import hinf_feedback, pi_feedback
from barbalat.vehicles.f16.axis import SAMPLE_TIME, Axis
from barbalat.vehicles.schemes import ROBUST, Numbers, OnLoop, Scheme, adaptive_gain, on_every_vehicle, protected


def _lqr(axis: Axis, _: Numbers) -> OnLoop:
    problem = axis.linear_problem
    return OnLoop(problem, Sampled(KnownParameters(theta=axis.gain, name="LQR"), SAMPLE_TIME, discretization="euler"))


def _linear(axis: Axis, numbers: Numbers) -> OnLoop:
    """Make SIMC's PI controller on the model-following error, with a crossover of ``bandwidth``."""
    delay = 1 / (2 * numbers["bandwidth"])
    linear = pi_feedback(axis.linear_problem.known, unmodelled_delay=delay, nominal=axis.gain, name="LQR with PI")
    return protected(axis, linear, axis.followed.crossover)


def _hinf(axis: Axis, numbers: Numbers) -> OnLoop:
    delay = 1 / (2 * numbers["bandwidth"])
    linear = hinf_feedback(axis.linear_problem.known, unmodelled_delay=delay, nominal=axis.gain, name="H-infinity")
    return protected(axis, linear, axis.followed.crossover)


def _mrac(axis: Axis, numbers: Numbers) -> OnLoop:
    mrac = Mrac(gamma=adaptive_gain(axis, numbers), theta_hat0=axis.nominal, modified_error=ModifiedError())
    return OnLoop(axis.adaptive_problem, Sampled(mrac, SAMPLE_TIME))


BANDWIDTH_RANGE = {"bandwidth": (0.5, 50.0)}
"""Range of the bandwidth [rad/s], from a bandwidth whose effect is hardly visible in a flight of 15 s to half a radian per
sample."""
ADAPTATION_RANGE = {"adaptation": (0.3, 100.0)}
"""Range of the frequency of the estimates [rad/s], up to a radian per sample."""
SCHEMES: dict[str, Scheme] = {
    "lqr": Scheme(_lqr, {}, counterpart="geometric"),
    "linear": Scheme(_linear, BANDWIDTH_RANGE, counterpart="geometric-integral"),
    ROBUST: Scheme(_hinf, BANDWIDTH_RANGE),
    **on_every_vehicle(_mrac, bandwidth=BANDWIDTH_RANGE, adaptation=ADAPTATION_RANGE),
}
"""The schemes by their names on the command line."""
TUNED: dict[str, dict[str, Numbers]] = {
    "f16-pitch": {
        "lqr": {},
        "linear": {"bandwidth": 6.11},
        "hinf": {"bandwidth": 2.04},
        "adrc": {"bandwidth": 4.9},
        "mrac": {"adaptation": 2.96},
        "robust-mrac": {"bandwidth": 4.76, "covariance": 0.31},
        "l1": {"bandwidth": 7.02, "adaptation": 75.3},
        "l1-piecewise": {"bandwidth": 7.3},
        "l1-piecewise-flown": {"bandwidth": 5.37},
    },
    "f16-roll": {
        "lqr": {},
        "linear": {"bandwidth": 6.19},
        "hinf": {"bandwidth": 2.18},
        "adrc": {"bandwidth": 6.74},
        "mrac": {"adaptation": 2.8},
        "robust-mrac": {"bandwidth": 6.75, "covariance": 0.001},
        "l1": {"bandwidth": 50.0, "adaptation": 2.83},
        "l1-piecewise": {"bandwidth": 8.42},
        "l1-piecewise-flown": {"bandwidth": 7.46},
    },
}
"""The tunings by flight and scheme, to three digits. They are the result of ``benchmarks/flight_tuning.py`` at 10,013 ft and
Mach 0.525."""
