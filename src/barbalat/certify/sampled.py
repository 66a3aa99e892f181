"""What sampling takes away from a continuous controller's certificate, and the limits of a law that takes Euler steps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from barbalat.certify.certificate import Certificate
from barbalat.certify.common import CONTINUOUS, OF_THE_PROBLEM
from barbalat.controllers import L1Adaptive, LinearFeedback, Mrac, Sampled
from barbalat.grid import Simulation
from barbalat.solvers import EULER

MIDPOINT = "no gain makes its law numerically unstable, so there is no gamma_max and no step_max"
AS_EULER = (
    "gamma_max and step_max are those of Euler's method at the sample time, plant included: cautious where the plant is fast, "
    "since it moves on between the samples"
)
ERRORS = ("error_bound", "error_bound_worst")


def judged_at(controller: Sampled, simulation: Simulation) -> Simulation:
    """The simulation whose numerics limit the controller: for a law that takes Euler steps, these steps."""
    if controller.discretization != "euler":
        return simulation
    T = controller.sample_time
    return Simulation(t_end=T * math.ceil(simulation.t_end / T * (1 - 1e-9)), dt=T, solver=EULER)


def certificate(continuous: Certificate, controller: Sampled) -> Certificate:
    """From the continuous controller's certificate at ``judged_at``."""
    what = f"the controller runs sampled every {controller.sample_time:g} s ({controller.discretization})"
    if isinstance(controller.controller, LinearFeedback):
        return replace(
            continuous,
            guaranteed=continuous.guaranteed & {"norms", "condition"},
            assumptions=(*continuous.assumptions, CONTINUOUS),
            findings=(*continuous.findings, what),
        )
    kept = continuous.guaranteed & (
        {"norms", "condition", "kappa_admissible", "kappa_max", "nu_0", "nu_0_worst"} | OF_THE_PROBLEM
    )
    if controller.discretization == "midpoint":
        values = {key: value for key, value in continuous.values.items() if key not in ("gamma_max", "step_max")}
        findings = (*continuous.findings, f"{what}; {MIDPOINT}", *_of_the_midpoint_form(controller))
        return Certificate(values, kept, (*continuous.assumptions, CONTINUOUS), findings)
    values, findings = dict(continuous.values), (*continuous.findings, what)
    step_max = values.get("step_max")
    if step_max is not None and step_max < controller.sample_time:
        lost = [key for key in ERRORS if values.pop(key, None) is not None]
        chatters = f"its law is numerically unstable where |x| is largest: it bears a sample time up to about {step_max:.3g} s"
        findings += (f"{chatters}; {' and '.join(lost)} of the continuous controller would not hold" if lost else chatters,)
    return Certificate(values, kept, (*continuous.assumptions, CONTINUOUS, AS_EULER), findings)


def _of_the_midpoint_form(controller: Sampled) -> list[str]:
    """What docs/sampled.md derives of the MRAC's, which has no filter between fast estimates and the input."""
    scheme, T = controller.controller, controller.sample_time
    if not isinstance(scheme, (Mrac, L1Adaptive)):
        return []
    findings = []
    if isinstance(scheme, Mrac) or scheme.filter is None:
        findings.append(
            f"for a high gain and short samples its loop inside the known set bears a delay of one sample, {T:g} s, at the "
            "plant's input; beyond that the estimates run between their bounds, and no bound of e is proven"
        )
    if np.ndim(scheme.gamma) == 2 or scheme.learning is not None:
        findings.append(
            "with a gain matrix or learning the predictor is fed with the estimate before its projection: while the projection "
            "acts, x_hat leaves x_m, and with a delay the loop may be lost"
        )
    return findings
