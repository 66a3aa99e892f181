"""From what is known of a plant to a linear controller, in one call."""

from __future__ import annotations

from barbalat.controllers import LinearFeedback
from barbalat.design.design_model import default_delay, delay_weight, design_model
from barbalat.design.hinf import mixed_sensitivity
from barbalat.design.pi import pi_controller
from barbalat.problem.state_feedback import Known
from barbalat.validate import Array


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
    """The mixed-sensitivity design around the nominal plant; its mu is computed for the delay that it was designed for.

    unmodelled_delay  [s] that the loop must bear at the plant's input; by default a tenth of the family's fastest time constant
    bandwidth         [rad/s]; by default the largest that the delay allows, less a tenth
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
    """The PI design around the nominal plant; parameters as in ``hinf_feedback``. Raises InputError as ``pi_controller`` does."""
    c, model = design_model(known, output)
    delay = default_delay(known) if unmodelled_delay is None else unmodelled_delay
    K = pi_controller(model, delay)
    return LinearFeedback(
        controller=K, output=c, nominal=nominal, unmodelled=delay_weight(delay), anti_windup=anti_windup, name=name
    )
