"""What the members of an exported state are, for the comments: by their places in the state, with the equations."""

from __future__ import annotations

MEANINGS = {
    "controller.theta_hat": "estimates of theta, then of the input gains where they are unknown: law (4), (7), (15) or (21)",
    "controller.x_hat": "state of the predictor (8)",
    "controller.y_hat": "output of the predictor (21)",
    "controller.filter": "state of the filter C(s) of (5), or Q(s) of (14)",
    "controller.xi": "filtered part of the parametric model (13) that is known",
    "controller.Xi": "filtered regressor of the parametric model (13)",
    "controller.n_d": "dynamic normalising signal of (16)",
    "controller.swapping": "swapping term of the auxiliary input (14)",
    "controller.memory.covariance": "covariance P of the least squares (15)",
    "controller.memory.R": "information matrix that the law remembers",
    "controller.memory.Q": "what the law remembers beside R",
    "controller.memory.zeta": "filtered motion of composite learning",
    "controller.memory.phi": "filtered regressor of composite learning",
    "controller.omega_1": "filtered control, alpha(s)/Lambda(s)[u]",
    "controller.omega_2": "filtered output, alpha(s)/Lambda(s)[y]",
    "controller.x_c": "state of the closed-loop reference model",
    "controller.e_d": "error that the input's limit causes",
    "controller.K": "state of the linear controller K(s)",
    "held.u": "control, held since the last sample",
    "held.measured": "measurement at the last sample",
    "held.x_m": "state of the reference model (2), exact for a held r",
    "held.r": "command at the last sample",
    "held.started": "0 before the first sample, then 1",
}


def meaning(path: str) -> str:
    """One phrase; a scheme of the user's own has members that are not known here."""
    return MEANINGS.get(path, "of the scheme's own state")
