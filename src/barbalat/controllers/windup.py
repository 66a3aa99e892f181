"""Windup remedies, which keep an adaptive law from learning while the input is at its limit.

There are two remedies, both off by default. If a scheme predicts the plant's state or output (L1-AC's predictor, the parametric
model of the normalised schemes), the prediction uses sat(u), which is what reaches the plant (``saturated_predictor``). MRAC,
which compares with the reference model instead, uses the modified error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.problem.output_feedback import OutputKnown
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Value
from barbalat.settings import Settings
from barbalat.validate import Array, InputError


@dataclass(frozen=True, kw_only=True)
class ModifiedError(Settings):
    """MRAC driven by e - e_d, e_d' = A_m e_d + b omega_hat (sat(u) - u_c): the law does not learn from the error due to the
    limit.

    mu      0 for the modified error of Karason and Annaswamy; above 0 for the positive mu-modification. Beyond the inner limits u
            is then (u_c + mu sat_inner(u_c))/(1 + mu), which keeps the control away from its limits
    margin  margin of the inner limits, 0 <= margin < 1; the inner limits are (1 - margin) times the actuator limits

    u_c = (-theta_hat'phi + k_0 r)/omega_hat is the control without a remedy; omega_hat = 1 if the input gain is known, and
    otherwise sat(u) is the regressor of omega in the law. Then exactly (e - e_d)' = A_m (e - e_d) - b (theta_tilde'phi +
    omega_tilde sat(u)), so V = (e - e_d)'P(e - e_d) + theta_tilde'Gamma^-1 theta_tilde, with omega_tilde included in theta_tilde,
    decreases as without a limit. Therefore the estimates and e - e_d are bounded; x_m + e_d is the adapted reference model.
    Boundedness of e_d itself is not claimed: with a limited input, an unstable plant can diverge from a sufficiently large
    initial state for any estimates.

    Source: Karason and Annaswamy (1994), IEEE TAC 39(11); Lavretsky and Hovakimyan (2007), Automatica 43(3), whose estimated gain
    on the control deficiency is omega_hat here.
    """

    mu: float = 0.0
    margin: float = 0.0

    def __post_init__(self) -> None:
        validate.freeze(self, mu=validate.not_negative("modified_error.mu", self.mu))
        margin = validate.not_negative("modified_error.margin", self.margin)
        if margin >= 1:
            raise InputError.of("modified_error.margin", f"must be below 1, got {margin:g}")
        validate.freeze(self, margin=margin)

    def control(self, u_c: Value, limits: Array) -> Value:
        """Return u from the control without the remedy; with mu = 0 it is unchanged, bit for bit."""
        inner = np.clip(u_c, (1 - self.margin) * limits[0], (1 - self.margin) * limits[1])
        return (u_c + self.mu * inner) / (1 + self.mu)


def known_limits(remedy: str, known: Known | OutputKnown) -> Array:
    """The actuators' limits, [lower, upper]; raises InputError if there are none."""
    if known.saturation is None:
        raise InputError(f"{remedy} needs plant.input.saturation, which is missing")
    return known.saturation


def limits_of_predictor(
    saturated_predictor: bool, known: Known | OutputKnown, *, remedy: str = "saturated_predictor"
) -> Array | None:
    """The actuators' limits if the remedy (``saturated_predictor`` or one with a different name) is switched on; otherwise
    None."""
    return known_limits(remedy, known) if saturated_predictor else None


def applied(u: Value, limits: Array | None) -> Value:
    """sat(u): the control after its limits, if the limits are taken into account."""
    return u if limits is None else np.clip(u, limits[0], limits[1])
