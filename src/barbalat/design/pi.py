"""PI control: the floor that any other design is measured against."""

from __future__ import annotations

import numpy as np

from barbalat import validate
from barbalat.linear.systems import TransferFunction
from barbalat.validate import InputError


def pi_controller(model: TransferFunction, delay: float) -> TransferFunction:
    """K(s) = k_p (1 + 1/(T_i s)) for a model with the unmodelled delay [s] at its input.

    SIMC with tau_c = delay (Skogestad, 2003): crossover near 1/(2 delay), where models of relative degree one are
    integrators; T_i = 8 delay. k_p makes the gain there one. Raises InputError where that leaves the loop unstable.
    """
    delay = validate.positive("unmodelled_delay", delay)
    crossover, T_i = 1 / (2 * delay), 8 * delay
    shape = TransferFunction([T_i, 1.0], [T_i, 0.0])
    gain = float(abs((shape * model).at(1j * crossover)))
    if gain == 0:
        raise InputError(f"a PI controller needs a model with gain at {crossover:.4g} rad/s, and it has none there")
    sign = np.sign(model.num[0])
    K = TransferFunction(sign * shape.num / gain, shape.den)
    loop = K * model
    closed = np.roots(np.polyadd(loop.num, loop.den))
    if closed.real.max() >= 0:
        raise InputError(
            f"the PI design for an unmodelled delay of {delay:.4g} s does not stabilise the model: a closed-loop pole has "
            f"real part {closed.real.max():.4g}; give the controller itself, another delay or another output"
        )
    return K
