"""The schemes of this project as additions to a geometric controller, axis by axis, with parameters found by one rule.

The parameters are in units of the axis, so that one range suits all axes.
"""

from __future__ import annotations

import numpy as np

from barbalat.controllers import KnownParameters, LinearFeedback, Mrac, Sampled
from barbalat.design import hinf_feedback
from barbalat.linear.systems import TransferFunction
from barbalat.vehicles.quadrotor.axes import CROSSOVER, Axis
from barbalat.vehicles.schemes import ROBUST, Numbers, OnLoop, Scheme, adaptive_gain, on_every_vehicle, protected


def _geometric(axis: Axis, _: Numbers) -> OnLoop:
    return OnLoop(
        axis.linear_problem,
        Sampled(KnownParameters(theta=np.zeros(2), name="Geometric"), axis.sample_time, discretization="euler"),
    )


def _integral(axis: Axis, numbers: Numbers) -> OnLoop:
    """Make the integral of Goodarzi, Lee, Leok, Geometric nonlinear PID control of a quadrotor UAV on SE(3), ECC 2013."""
    integral = TransferFunction([numbers["corner"] * axis.frequency * axis.gain[1]], [1.0, 0.0])
    linear = LinearFeedback(integral, output=axis.gain / axis.gain[1], name="Geometric, integral")
    return OnLoop(axis.linear_problem, Sampled(linear, axis.sample_time))


def _hinf(axis: Axis, numbers: Numbers) -> OnLoop:
    """Make an H-infinity controller on the integral's output, as for the F-16 on the output of the PI controller, with the same
    windup protection."""
    linear = hinf_feedback(
        axis.linear_problem.known,
        unmodelled_delay=axis.lag / (2 * numbers["bandwidth"]),
        output=axis.gain / axis.gain[1],
        nominal=np.zeros(2),
        name="H-infinity",
    )
    return protected(axis, linear, CROSSOVER * axis.frequency)


def _mrac(axis: Axis, numbers: Numbers) -> OnLoop:
    return OnLoop(axis.adaptive_problem, Sampled(Mrac(gamma=adaptive_gain(axis, numbers)), axis.sample_time))


BANDWIDTH = {"bandwidth": (0.02, 4.0)}
"""Range of the bandwidth in units of the inverse lag of the axis. At the lower end the effect is hardly visible in a flight; the
upper end is four times the limit for a loop with one integrator and that lag."""
DESIGN_BANDWIDTH = {"bandwidth": (0.025, 4.0)}
"""Range of the bandwidth for H-infinity, from the smallest value at which a design exists for every axis. For a longer delay, the
weights cannot be met by any controller around the feedback loop."""
CORNER = {"corner": (0.01, 2.0)}
"""Range of the corner relative to the natural frequency of the axis."""
ADAPTATION = {"adaptation": (0.03, 30.0)}
"""Range of the frequency of the estimates relative to the natural frequency of the axis, up to half a radian per sample or
more."""
SCHEMES: dict[str, Scheme] = {
    "geometric": Scheme(_geometric, {}, counterpart="lqr"),
    "geometric-integral": Scheme(_integral, CORNER, counterpart="linear"),
    ROBUST: Scheme(_hinf, DESIGN_BANDWIDTH),
    **on_every_vehicle(_mrac, bandwidth=BANDWIDTH, adaptation=ADAPTATION),
}
"""The schemes by their names on the command line."""
TUNED: dict[str, dict[str, Numbers]] = {
    "roll": {
        "geometric": {},
        "geometric-integral": {"corner": 0.11},
        ROBUST: {"bandwidth": 0.11},
        "adrc": {"bandwidth": 0.316},
        "mrac": {"adaptation": 0.806},
        "robust-mrac": {"bandwidth": 0.316, "covariance": 0.00369},
        "l1": {"bandwidth": 0.327, "adaptation": 30.0},
        "l1-piecewise": {"bandwidth": 0.331},
        "l1-piecewise-flown": {"bandwidth": 0.332},
    },
    "yaw": {
        "geometric": {},
        "geometric-integral": {"corner": 0.444},
        ROBUST: {"bandwidth": 0.0913},
        "adrc": {"bandwidth": 0.13},
        "mrac": {"adaptation": 1.24},
        "robust-mrac": {"bandwidth": 0.13, "covariance": 100.0},
        "l1": {"bandwidth": 0.13, "adaptation": 30.0},
        "l1-piecewise": {"bandwidth": 2.1},
        "l1-piecewise-flown": {"bandwidth": 3.03},
    },
    "forward": {
        "geometric": {},
        "geometric-integral": {"corner": 0.164},
        ROBUST: {"bandwidth": 0.0306},
        "adrc": {"bandwidth": 0.0853},
        "mrac": {"adaptation": 0.405},
        "robust-mrac": {"bandwidth": 0.129, "covariance": 1.27},
        "l1": {"bandwidth": 0.0752, "adaptation": 30.0},
        "l1-piecewise": {"bandwidth": 0.0855},
        "l1-piecewise-flown": {"bandwidth": 0.0861},
    },
}
"""The tunings by ``Axis.like`` and scheme, to three digits. They are the result of ``benchmarks/flight_tuning.py`` on the vehicle
at hover."""
