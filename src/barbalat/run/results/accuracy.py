"""The error of a run from t = 0 on, measured against a variable-step run. A variable-step run is compared with a second one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from barbalat.validate import Array

OPEN = 0.1
"""A metric is not resolved if two runs with different tolerances differ by more than this fraction of it."""


@dataclass(frozen=True)
class Accuracy:
    """The accuracy of a variable-step run.

    tolerance  admissible error of each step
    finer      the tolerance of the second run
    error      by state name ("x" and "theta_hat"), the largest difference between the two runs at the recorded instants, relative
               to the component's largest magnitude; None if a run does not reach the end
    figures    by metric name, the largest difference between the two runs, relative to the value in the second run; None in the
               same case
    steps      number of accepted steps; ``rejected`` steps failed, and ``choices`` steps ended at a jump or corner of the
               equations
    """

    tolerance: float
    finer: float
    error: dict[str, float | None]
    figures: dict[str, float | None]
    steps: int
    rejected: int
    choices: int

    @property
    def unresolved(self) -> tuple[str, ...]:
        """The metrics that the tolerance does not resolve."""
        return tuple(name for name, value in self.figures.items() if value is not None and value > OPEN)

    @property
    def in_brief(self) -> str:
        """The measured error and the metrics that the tolerance does not resolve, on one line."""
        told = _told(self.error)
        if not told:
            return f"error not measured, since a run at {self.finer:g} does not reach the end"
        names = ", ".join(self.unresolved)
        of_them = (
            f"; {names} {'is' if len(self.unresolved) == 1 else 'are'} not resolved: use a smaller tolerance" if names else ""
        )
        return f"measured error {told}{of_them}"

    @property
    def sentence(self) -> str:
        """In one line."""
        ended = f", {self.choices} of them ending at a corner or a jump of the equations" if self.choices else ""
        how = "" if all(value is None for value in self.error.values()) else f", by a second run at {self.finer:g}"
        return f"tolerance {self.tolerance:g}: {self.in_brief}{how}; {self.steps} steps of DOP853{ended}"

    def as_json(self) -> dict[str, Any]:
        return vars(self) | {"sentence": self.sentence}


@dataclass(frozen=True)
class MeasuredError:
    """The error of a fixed-step run, measured by a variable-step run.

    tolerance  tolerance of that run
    error      as in ``Accuracy``, up to the time ``until`` [s] that both runs reach; empty if nothing is measured
    own        the error of that run, measured by another run with a finer tolerance
    reason     the reason if nothing is measured, otherwise None
    """

    tolerance: float
    error: dict[str, float | None]
    own: dict[str, float | None]
    until: float
    reason: str | None = None

    @property
    def sentence(self) -> str:
        """In one line."""
        told, own = _told(self.error), _told(self.own)
        if self.reason is not None or not told:
            return f"error not measured: {self.reason or 'no variable-step run reaches the end'}"
        itself = f", whose own error is {own}" if own else ""
        return f"measured error {told} up to t = {self.until:g} s, by a run with a tolerance of {self.tolerance:g}{itself}"

    def as_json(self) -> dict[str, Any]:
        return vars(self) | {"sentence": self.sentence}


def differences(states: Array, others: Array, rows: Mapping[str, Array]) -> dict[str, float | None]:
    """The largest differences between the states (K, S) of two runs by the names of ``rows``, relative to the magnitudes of the
    components."""
    with np.errstate(invalid="ignore"):
        largest = np.maximum(np.abs(others).max(axis=0), np.finfo(float).tiny)
        differs = np.abs(states - others).max(axis=0) / largest
    found = {name: float(differs[which].max()) for name, which in rows.items() if len(which)}
    return {name: v if np.isfinite(v) else None for name, v in found.items()}


def relative_differences(figures: Mapping[str, Any], others: Mapping[str, Any]) -> dict[str, float | None]:
    """The largest difference in each metric between two runs, relative to its largest entry in the other run; None without a
    value."""
    found: dict[str, float | None] = {}
    for name, value in figures.items():
        one, other = (np.atleast_1d(np.array(given, dtype=float)) for given in (value, others[name]))
        largest = np.abs(other).max(initial=0.0)
        differs = float(np.abs(one - other).max(initial=0.0) / max(largest, np.finfo(float).tiny))
        found[name] = differs if np.isfinite(differs) else None
    return found


def _told(error: Mapping[str, float | None]) -> str:
    return " and ".join(f"{value:.2g} in {name}" for name, value in error.items() if value is not None)
