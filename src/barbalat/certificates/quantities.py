"""The meanings and units of certificate values, for keys that several schemes share.

A key that belongs to a single scheme is explained in the file of that scheme, which passes it to its ``Draft``. The command line
prints these texts.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Form(Enum):
    """The structure of a value, which determines how it is shown."""

    PLAIN = "a number, a list of numbers or words"
    MATRIX = "rows of numbers"
    NAMES = "a list of names"
    NORMS = "lower and upper for each system, by its name"
    BOUNDS = "a bound for each signal, by its name"
    CONDITION = "value_upper, limit, holds, and the system of the norm"
    OVER_THE_SET = "the smallest margins of each linear loop over the known set"
    TRANSFER_FUNCTIONS = "num and den for each transfer function, by its name"
    PER_UNIT = "the error per unit of each signal, by its name"


class Quantity(NamedTuple):
    """The meaning of a key.

    below     marks a guarantee that holds for everything below the value but not above it
    timeless  whether the value belongs to the problem, to a filter or to t = 0, so that sampling does not change it
    """

    meaning: str
    unit: str = ""
    below: bool = False
    form: Form = Form.PLAIN
    timeless: bool = False


QUANTITIES = {
    "nu_0": Quantity("|theta_tilde(0)|/sqrt(lambda_min(P))", timeless=True),
    "nu_0_worst": Quantity("the same for the worst theta of the known set", timeless=True),
    "initial_parameter_error": Quantity("|theta_tilde(0)|", timeless=True),
    "P": Quantity("P A_m + A_m'P = -I, row by row", form=Form.MATRIX),
    "lambda_min": Quantity("smallest eigenvalue of P, from below", below=True, timeless=True),
    "theta_max": Quantity("largest |theta|_1 of the known set", timeless=True),
    "bounds": Quantity("bounds on |r| and on every component of x_m, at all times", form=Form.BOUNDS, timeless=True),
    "norms": Quantity("L1 norms, enclosed", form=Form.NORMS, timeless=True),
    "condition": Quantity("a norm times a size; the condition holds if it is below 1", form=Form.CONDITION, timeless=True),
    "error_bound": Quantity("one number that bounds every component of e, each in its own unit, at all times"),
    "error_bound_worst": Quantity("the same for the worst theta of the known set"),
    "error_bound_command": Quantity(
        "bound on every component of e for any theta of the known set, under the case's command up to t_end"
    ),
    "adaptation_frequency": Quantity("frequency of the frozen oscillator of adaptation", "rad/s"),
    "gamma_max": Quantity(
        "the solver, or a law with Euler steps, is stable at its step at least up to this gain, with |x| at its bound"
    ),
    "step_max": Quantity("the solver is stable with this gain at least up to this step, with |x| at its bound", "s"),
    "gamma_float32": Quantity("gain above which the loop with a compiled 32-bit export deviates from the simulation"),
    "gamma_max_at_model": Quantity(
        "the same with |x| as large as the command makes |x_m|; in runs, oscillations start near this gain, from 0.6 times it on"
    ),
    "step_max_at_model": Quantity(
        "the same with |x| as large as the command makes |x_m|; in runs, oscillations start near this step, from 0.8 times it on",
        "s",
    ),
    "delay_margin": Quantity("smallest destabilising delay: linear, without limits", "s"),
    "phase_margin": Quantity("smallest destabilising phase lag: linear, without limits", "rad"),
    "gain_margin": Quantity("smallest destabilising factor above 1, up to 1e6: linear, without limits"),
    "gain_reduction_margin": Quantity("largest destabilising factor below 1, down to 1e-6: linear, without limits"),
    "sensitivity_peak": Quantity("max |S|"),
    "complementary_sensitivity_peak": Quantity("max |T|"),
    "margins_of": Quantity("the linear loop of the margins above"),
    "unlimited": Quantity("the margins without a limit; for gains, no factor up to 1e6", form=Form.NAMES),
    "margins_over_known_set": Quantity(
        "the smallest margins found over the known set or the parameters' ranges, and where", form=Form.OVER_THE_SET
    ),
    "delay_margin_adapting": Quantity(
        "delay margin of the loop with its law, linearised at the largest constant command, without limits", "s"
    ),
    "delay_margin_measured": Quantity("measured on the case with its limits: largest delay before loss or a limit cycle", "s"),
    "gain_margin_measured": Quantity("measured on the case with its limits: tolerated factor and divisor of the input gain"),
    "delay_onset_simulated": Quantity("the same as delay_margin_measured", "s"),
    "delay_margin_simulated": Quantity("measured: largest delay before loss of the motion, see below", "s"),
    "mu_parameters": Quantity("mu with respect to the known set"),
    "parameter_scale": Quantity("factor by which the known set may grow"),
    "theta_destabilising": Quantity("parameters that destabilise the loop"),
    "mu_dynamics": Quantity("mu with respect to the unmodelled dynamics"),
    "mu": Quantity("mu with respect to both"),
    "mu_frequency": Quantity("frequency at which mu peaks", "rad/s"),
}

EACH_INPUT = {
    key: f"{key}_each" for key in ("delay_margin", "phase_margin", "gain_margin", "gain_reduction_margin", "sensitivity_peak")
}
"""Keys for a plant with several inputs, by the keys for one input."""
QUANTITIES |= {
    of_each: Quantity(f"for each input separately: {QUANTITIES[key].meaning}", QUANTITIES[key].unit)
    for key, of_each in EACH_INPUT.items()
}

ON_DAMPING = {
    "gamma_max": Quantity(
        "approximate gain up to which the frozen law's damping exceeds the amplification by the step, with |x| at its bound"
    ),
    "step_max": Quantity(
        "approximate step up to which the frozen law's damping exceeds its amplification, with |x| at its bound", "s"
    ),
}
"""The limits for a method that amplifies every undamped oscillation; they are not lower bounds, see ``cells.on_damping``."""
