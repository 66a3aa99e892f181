"""Rate limits at a plant's inputs in variable-step runs.

A limiter either follows its demand or moves towards it at its limit. It becomes active when the demand jumps or changes faster
than the limit, and inactive when it has reached the demand again; steps end at both instants. While it is inactive, its output
changes at the rate of the demand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from barbalat.lowering.switching import Condition

if TYPE_CHECKING:
    import casadi as ca

SAME = 32 * 2.0**-52
"""Relative distance of the compared values below which a choice is undetermined."""


@dataclass(frozen=True, eq=False)
class Limiters:
    """All limiters of a loop at one instant, (L,) each.

    outputs  outputs of the limiters; ``demands`` are their inputs, and ``speeds`` the rates of the demands [1/s]
    limits   limits of the rates [1/s]
    """

    outputs: ca.SX
    demands: ca.SX
    speeds: ca.SX
    limits: ca.SX

    def conditions(self, choices: ca.SX | None) -> list[Condition]:
        """For each limiter, whether it moves upwards at its limit, and whether it moves downwards at its limit; with ``choices``
        (2 L,), whether it continues to do so."""
        import casadi as ca

        found = []
        for i in range(self.limits.numel()):
            gap, speed, limit = self.demands[i] - self.outputs[i], self.speeds[i], self.limits[i]
            size, fast = ca.fabs(self.demands[i]) + ca.fabs(self.outputs[i]), ca.fabs(speed) + limit
            for sign, own, other in ((1, 2 * i, 2 * i + 1), (-1, 2 * i + 1, 2 * i)):
                if choices is None:
                    behind = sign * gap > SAME * size
                    together = ca.fabs(gap) <= SAME * size
                    truth = ca.logic_or(behind, ca.logic_and(together, sign * speed > limit))
                    found.append(Condition(truth, sign * gap, size))
                    continue
                margin = ca.if_else(choices[other], -ca.inf, sign * speed - limit)
                margin = ca.if_else(choices[own], sign * gap, margin)
                found.append(Condition(margin > 0, margin, ca.if_else(choices[own], size, fast)))
        return found

    def rates(self, choices: ca.SX) -> ca.SX:
        """The slopes of the limiters' outputs."""
        import casadi as ca

        found = []
        for i in range(self.limits.numel()):
            down = ca.if_else(choices[2 * i + 1], -self.limits[i], self.speeds[i])
            found.append(ca.if_else(choices[2 * i], self.limits[i], down))
        return ca.vertcat(*found)

    def joined(self, scales: ca.SX) -> ca.SX:
        """The outputs, replaced by the demand if a step has ended within ``scales`` (L,) of it."""
        import casadi as ca

        found = []
        for i in range(self.limits.numel()):
            gap = ca.fabs(self.demands[i] - self.outputs[i])
            near = gap <= scales[i] * (1 + ca.fabs(self.speeds[i]) / self.limits[i])
            found.append(ca.if_else(near, self.demands[i], self.outputs[i]))
        return ca.vertcat(*found)


def following_outputs(demands: ca.SX, outputs: ca.SX, choices: ca.SX) -> ca.SX:
    """The outputs, without the integration's error for inactive limiters."""
    import casadi as ca

    moving = [ca.logic_or(choices[2 * i], choices[2 * i + 1]) for i in range(demands.numel())]
    return ca.vertcat(*(ca.if_else(one, outputs[i], demands[i]) for i, one in enumerate(moving)))


def with_rows(column: ca.SX, rows: tuple[int, ...], values: ca.SX) -> ca.SX:
    """The column with these values in these rows."""
    import casadi as ca

    parts = ca.vertsplit(column)
    for i, row in enumerate(rows):
        parts[row] = values[i]
    return ca.vertcat(*parts)
