"""PI control, and functions that design linear controllers for the known part of a plant in one call."""

from __future__ import annotations

import numpy as np

from barbalat import validate
from barbalat.controllers import LinearFeedback
from barbalat.design.hinf import default_delay, delay_weight, design_model, mixed_sensitivity
from barbalat.linear.systems import TransferFunction
from barbalat.problem.state_feedback import Known
from barbalat.validate import Array, InputError


def pi_controller(model: TransferFunction, delay: float) -> TransferFunction:
    """K(s) = k_p (1 + 1/(T_i s)) for a model with the unmodelled delay [s] at its input.

    SIMC with tau_c = delay (Skogestad, 2003): crossover near 1/(2 delay), where models of relative degree one are integrators;
    T_i = 8 delay. k_p makes the gain one at the crossover. Raises InputError if the loop is then unstable.
    """
    delay = validate.positive("unmodelled_delay", delay)
    crossover, T_i = 1 / (2 * delay), 8 * delay
    shape = TransferFunction([T_i, 1.0], [T_i, 0.0])
    gain = float(abs((shape * model).at(1j * crossover)))
    if gain == 0:
        raise InputError(f"a PI controller needs a model with gain at {crossover:.4g} rad/s, but this model has none there")
    sign = np.sign(model.num[0])
    K = TransferFunction(sign * shape.num / gain, shape.den)
    loop = K * model
    closed = np.roots(np.polyadd(loop.num, loop.den))
    if closed.real.max() >= 0:
        raise InputError(
            f"the PI design for an unmodelled delay of {delay:.4g} s does not stabilise the model: a closed-loop pole has "
            f"real part {closed.real.max():.4g}; give the controller itself, a different delay or a different output"
        )
    return K


def hinf_feedback(
    known: Known,
    *,
    unmodelled_delay: float | None = None,
    bandwidth: float | None = None,
    output: Array | None = None,
    nominal: Array | None = None,
    anti_windup: float | None = None,
    name: str = "H-infinity",
) -> LinearFeedback:
    """The mixed-sensitivity design for the nominal plant; mu is computed for the delay of the design.

    unmodelled_delay  delay [s] that the loop must tolerate at the plant's input; by default a tenth of the fastest time constant
                      of the family
    bandwidth         [rad/s]; by default 0.9 times the largest bandwidth that the delay allows
    output, nominal, anti_windup  as in LinearFeedback

    Raises InputError as ``mixed_sensitivity`` does.
    """
    c, model = design_model(known, output)
    delay = default_delay(known) if unmodelled_delay is None else unmodelled_delay
    K = mixed_sensitivity(model, delay, bandwidth).controller
    return LinearFeedback(
        controller=K, output=c, nominal=nominal, unmodelled=delay_weight(delay), anti_windup=anti_windup, name=name
    )


def pi_feedback(
    known: Known,
    *,
    unmodelled_delay: float | None = None,
    output: Array | None = None,
    nominal: Array | None = None,
    anti_windup: float | None = None,
    name: str = "PI",
) -> LinearFeedback:
    """The PI design for the nominal plant; for the parameters, see ``hinf_feedback``. Raises InputError as ``pi_controller``
    does."""
    c, model = design_model(known, output)
    delay = default_delay(known) if unmodelled_delay is None else unmodelled_delay
    K = pi_controller(model, delay)
    return LinearFeedback(
        controller=K, output=c, nominal=nominal, unmodelled=delay_weight(delay), anti_windup=anti_windup, name=name
    )
