"""Between which sizes of a modelling error, such as delays, loops are lost: what is known of each, narrowed by every run."""

from __future__ import annotations

from enum import Enum

import numpy as np

from barbalat.solvers.simulation import Simulation
from barbalat.study.ideal_benchmark import SHORTEST_DELAY_STEPS
from barbalat.validate import Array, InputError, hint, show

LONGEST_DELAY = 2.0
"""The largest delay that is tried unless another is asked for [s]."""
SCANNED_DELAYS = 12
"""Delays up to that one, from the shortest on: a factor of 2 to 3 from one to the next."""


class Criterion(Enum):
    """By which of the two a loop is lost."""

    ONSET = "onset"
    LOSS = "loss"

    @classmethod
    def accept(cls, field: str, given: Criterion | str) -> Criterion:
        """One of the two, given itself or by its name; InputError names the field."""
        known = [one.value for one in cls]
        if not isinstance(given, cls) and given not in known:
            raise InputError.of(field, f"must be {' or '.join(known)}, got {show(given)}{hint(given, known)}")
        return cls(given)


LARGEST_GAIN_ERROR = 15.0
"""The largest factor on the input's effectiveness that is tried is 16, and the smallest 1/16: 24 dB."""
GAINS_SCANNED = 6
"""Up to that one: a factor of 3 from one size to the next."""
SMALLEST_GAIN_ERROR = 0.05
"""A loop that bears less than half a decibel bears nothing that is known so well."""


def gains_scanned() -> Array:
    """The sizes of ``GainError`` that are tried first."""
    return np.asarray(np.geomspace(SMALLEST_GAIN_ERROR, LARGEST_GAIN_ERROR, GAINS_SCANNED))


def scanned(simulation: Simulation, longest: float, count: int) -> Array:
    """The delays that are tried first, geometrically apart [s]."""
    return np.asarray(np.geomspace(SHORTEST_DELAY_STEPS * simulation.dt, longest, count))


class DelaySearch:
    """The brackets of M members, (2, M): by the onset, by the loss."""

    def __init__(self, tracks: Array, begun: Array, scan: int, halvings: int) -> None:
        """tracks (M,) and begun (M,): who follows the model, and whose onset lies at no modelling error at all."""
        self.scans_left, self.halvings_left, self.runs = scan, halvings, 0
        self.bears = np.zeros((2, len(tracks)))
        self.loses = np.tile(np.where(tracks, np.inf, 0.0), (2, 1))
        self.loses[0, begun] = 0.0

    def open_members(self) -> Array:
        """Those of which a criterion has not seen a losing delay yet."""
        return np.flatnonzero(np.isinf(self.loses).any(axis=0))

    def between(self) -> tuple[Array, Array]:
        """(members, sizes): the middle of every bracket, once where both criteria have the same."""
        middles = np.sqrt(self.bears * self.loses)
        asked = [(i, middles[c, i]) for c, i in np.argwhere((self.bears > 0) & np.isfinite(self.loses))]
        pairs = sorted(set(asked))
        return np.array([i for i, _ in pairs], dtype=int), np.array([size for _, size in pairs])

    def take(self, chosen: Array, added: Array, verdicts: tuple[Array, Array]) -> None:
        """Narrow what members ``chosen`` lie within by their verdicts with errors of the sizes ``added``: onset, loss."""
        for size in np.unique(added):  # from short to long: a member may have been run with several
            for c, lost in enumerate(verdicts):
                within = (added == size) & (self.bears[c, chosen] < size) & (size < self.loses[c, chosen])
                self.loses[c, chosen[within & lost]] = size
                self.bears[c, chosen[within & ~lost]] = size
        self.runs += len(chosen)

    def to_come(self) -> float:
        """Runs that are expected still: as if the members that are open were lost evenly over the rest of the scan."""
        scans = len(self.open_members()) * (1 + self.scans_left / 2)
        inside = (self.loses > 0) & ~((self.bears == 0) & np.isfinite(self.loses))
        both = inside.all(axis=0) & (self.loses[0] == self.loses[1])
        return float(scans + self.halvings_left * (inside.sum() - 0.5 * both.sum()))
