"""The numbers in a proof from which the guarantees of a controller follow, in the form that ``barbalat-check`` reads.

The file of a scheme provides these numbers through a function ``grounds``; docs/proofs.md explains them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.adaptation.lyapunov import ModifiedSettings
from barbalat.adaptation.modifications import SwitchingSigma
from barbalat.certificates.bounds.disturbed import decay, largest_eigenvalue
from barbalat.certificates.bounds.laws import Bound, least_gain
from barbalat.linear.systems import StateSpace
from barbalat.problem.state_feedback import Known
from barbalat.validate import Array


def of_lyapunov_law(
    scheme: str,
    equations: Bound,
    gamma: float | Array,
    closed: Known,
    law: ModifiedSettings | None = None,
    *,
    carries: bool = False,
) -> dict[str, Any]:
    """The numbers of a scheme with V = e'P e + theta_tilde'Gamma^-1 theta_tilde, with the P of ``closed``, and the modifications
    of its law.

    With ``carries``, V includes bounded disturbances, and the numbers include the eigenvalues that this requires.
    """

    def name_of(part: Any) -> str | None:
        return None if part is None else type(part).__name__

    leakage = None if law is None else law.leakage
    pulls: dict[str, Any] | None = None if leakage is None else {"kind": type(leakage).__name__}
    if isinstance(leakage, SwitchingSigma):
        pulls = {"kind": "switching", "M_0": leakage.M_0}
    return {
        "scheme": scheme,
        "P": closed.P.tolist(),
        "theta_hat0": equations.theta_hat0.tolist(),
        "gamma": plain(gamma),
        "projection": equations.estimate_set is not None,
        "leakage": pulls,
        "dead_zone": None if law is None else name_of(law.dead_zone),
        "learning": None if law is None else name_of(law.learning),
    } | ({"carried": carried(gamma, closed)} if carries else {})


def carried(gamma: float | Array, closed: Known) -> dict[str, float]:
    """The eigenvalues used by a bound on V with disturbances."""
    return {"decay": decay(closed), "largest": largest_eigenvalue(closed.P), "least_gain": least_gain(gamma)}


def plain(value: float | Array) -> Any:
    """A number, or lists of them."""
    return np.asarray(value, dtype=float).tolist()


def of_system(system: StateSpace) -> dict[str, Any]:
    """The matrices of a system with one input and one output."""
    return {"A": system.A.tolist(), "B": system.B.tolist(), "C": system.C.tolist(), "D": float(system.D)}
