"""Remedies against windup: what an adaptive law must not learn from an input that is at its limit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.problem import Known
from barbalat.protocols import Value
from barbalat.validate import Array, InputError


@dataclass(frozen=True, kw_only=True)
class ModifiedError:
    """MRAC driven by e - e_d, e_d' = A_m e_d + b (sat(u) - u_c): the error that the limit causes is not learnt from.

    mu      0: the modified error of Karason and Annaswamy. Above 0 the positive mu-modification: beyond the inner limits
            u = (u_c + mu sat_inner(u_c))/(1 + mu), which keeps the control away from its limits
    margin  of the inner limits, 0 <= margin < 1: they are (1 - margin) times the actuator's

    u_c = -theta_hat'phi + k_0 r is the control without remedy. (e - e_d)' = A_m (e - e_d) - b theta_tilde'phi, so that
    V = (e - e_d)'P(e - e_d) + theta_tilde'Gamma^-1 theta_tilde decreases as without a limit. x_m + e_d is the adapted reference
    model. Source: Karason and Annaswamy (1994), IEEE TAC 39(11); Lavretsky and Hovakimyan (2007), Automatica 43(3).
    """

    mu: float = 0.0
    margin: float = 0.0

    def __post_init__(self) -> None:
        validate.freeze(self, mu=validate.not_negative("modified_error.mu", self.mu))
        margin = validate.not_negative("modified_error.margin", self.margin)
        if margin >= 1:
            raise InputError(f"modified_error.margin must be below 1, got {margin:g}")
        validate.freeze(self, margin=margin)

    def control(self, u_c: Value, limits: Array) -> Value:
        """u from the control without remedy."""
        if self.mu == 0:
            return u_c
        inner = np.clip(u_c, (1 - self.margin) * limits[0], (1 - self.margin) * limits[1])
        return (u_c + self.mu * inner) / (1 + self.mu)


def known_limits(remedy: str, known: Known) -> Array:
    """The actuators' limits, [lower, upper]; InputError where there are none, or the input gain is unknown."""
    if known.saturation is None:
        raise InputError(f"{remedy} needs plant.input.saturation, which is not given")
    if known.uncertainty.gain_unknown:
        raise InputError(f"{remedy} takes the input gain as known, but uncertainty.input_gain is given")
    return known.saturation
