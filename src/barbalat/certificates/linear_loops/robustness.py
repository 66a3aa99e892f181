"""mu of a linear loop against the known set and unmodelled dynamics, under the certificate's keys."""

from __future__ import annotations

from typing import Any

import numpy as np

from barbalat.certificates.requested_keys import is_needed
from barbalat.linear.robust_stability import MatchedFamily, RobustStability, robust_stability
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.problem.known_set import KnownSet
from barbalat.validate import Array, InputError

KEYS = ("mu_parameters", "parameter_scale", "theta_destabilising", "mu_dynamics", "mu", "mu_frequency")


def robustness(
    loop: StateSpace, known_set: KnownSet | None, weight: TransferFunction | None, findings: list[str]
) -> dict[str, Any]:
    """mu against the known set, against the unmodelled dynamics of size ``weight``, and against both, by the certificate's keys.

    ``loop`` stands at the set's centre, or where there is none, at the true theta.
    """
    values: dict[str, Any] = {}
    if not is_needed(*KEYS):
        return values

    def measure(width: Array, weight: TransferFunction | None) -> RobustStability:
        return robust_stability(MatchedFamily(loop=loop, width=width, weight=weight))

    width = np.zeros(1) if known_set is None else known_set.extent[1] - known_set.middle
    try:
        if known_set is not None:
            found = measure(width, None)
            values |= {"mu_parameters": found.peak, "parameter_scale": found.scale if found.peak > 0 else None}
            if found.delta is not None:
                values["theta_destabilising"] = (known_set.middle + width * found.delta).tolist()
            if not known_set.fills_its_extent:
                findings.append("mu is that of the box around the known set: more than the set's own")
        if weight is not None:
            values["mu_dynamics"] = measure(0 * width, weight).peak
            if known_set is not None:
                both = measure(width, weight)
                values |= {"mu": both.peak, "mu_frequency": both.frequency}
    except InputError as error:
        findings.append(str(error))
    return values
