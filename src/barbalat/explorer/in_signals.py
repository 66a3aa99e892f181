"""The effect of a number of the case on its commands and disturbances, as far as a page can reproduce it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from barbalat.cases.build import Case
from barbalat.explorer.commands import Grid, breaks_anywhere, is_computed, is_formula
from barbalat.explorer.faults import drawn_by
from barbalat.loop.structure import identical
from barbalat.open_numbers.numbers import At, Number
from barbalat.open_numbers.path import Key
from barbalat.open_numbers.probe import thinned
from barbalat.protocols import InterpolatedSignal, Signal
from barbalat.run.kernel.template import Columns
from barbalat.solvers import RK4
from barbalat.validate import InputError


@dataclass(frozen=True, eq=False)
class InSignals:
    """The effect of a number on the signals.

    places  indices of the number among the numbers of the smooth signals
    scales  indices of the other signals all of whose values are the number, its negative, or zero
    grids   a grid for each value of the number, at the step and horizon of the case, if the other signals depend on the number in
            a different way
    drawn   the signal of the fault and the keys in it, if the number determines a fault
    """

    places: list[int]
    scales: list[int]
    grids: list[Grid] | None = None
    drawn: tuple[int, list[Key]] | None = None


@dataclass(frozen=True, eq=False)
class SignalSearch:
    """Finds the effect from cases with different values of the number."""

    case: Case
    at: At

    def of(self, number: Number, room: int) -> tuple[Number, InSignals] | None:
        """Return the number and its effect, or None if a page cannot reproduce it. The number has fewer values if grids depend on
        it; together these take at most ``room`` bytes."""
        if (drawn := drawn_by(number.path, self.case.problem.signals)) is not None:
            return number, InSignals([], [], drawn=drawn)
        found = self._moved(number)
        return self._gridded(number, room) if found is None else (number, found)

    def _moved(self, number: Number) -> InSignals | None:
        """Return the effect without grids, or None if signals depend on the number in a different way."""
        tried_values = [number.value, number.values[0], number.values[-1]]
        tried = [self.case, *(self.at(number.path, float(v)) for v in tried_values[1:])]
        signals = [case.problem.signals for case in tried]
        if all(identical(one, signals[0]) for one in signals):
            return InSignals([], [])
        formulas = [tuple(signal for signal in one if is_formula(signal)) for one in signals]
        if breaks_anywhere(formulas[0]) or not all(map(_same_records, signals, [signals[0]] * len(signals))):
            return None
        scales = self._scaled(signals, tried_values)
        if scales is None or not formulas[0]:
            return None if scales is None else InSignals([], scales)
        columns = Columns(formulas[0])
        for one in formulas[1:]:
            columns.add(one)
        values = columns.everything()
        moved = np.flatnonzero((values != values[:, :1]).any(axis=1))
        return InSignals([int(i) for i in moved], scales) if (values[moved] == tried_values).all() else None

    def _gridded(self, number: Number, room: int) -> tuple[Number, InSignals] | None:
        """Return the number with those values for which signals that jump have a grid like the grid of the case, and the
        grids."""
        simulation, whole = self.case.simulation, self.case.problem.delay > 0
        given, grids = list[float](), list[Grid]()
        own = self.case.problem.signals
        for value in thinned(number).values.tolist():
            try:
                signals = self.at(number.path, value).problem.signals
                grid = Grid.of(signals, replace(simulation, solver=RK4), whole=whole)
            except InputError:  # the case is invalid, or there are too many rows
                continue
            if any(is_computed(one) and not identical(one, mine) for one, mine in zip(signals, own, strict=True)):
                return None
            given.append(value)
            grids.append(grid)
        if number.value not in given:
            return None
        pieces = bool(len(grids[given.index(number.value)].cuts))
        fits = [i for i, grid in enumerate(grids) if bool(len(grid.cuts)) == pieces]
        if len(fits) < 2 or sum(grids[i].bytes for i in fits) > room:
            return None
        return replace(number, values=np.array([given[i] for i in fits])), InSignals([], [], [grids[i] for i in fits])

    def _scaled(self, signals: Sequence[tuple[Signal, ...]], values: Sequence[float]) -> list[int] | None:
        """Return which of the signals that are stored as rows are always the number times -1, 0 or 1; None if a signal depends on
        the number in a different way."""
        rough = [tuple(signal for signal in one if not is_computed(signal)) for one in signals]
        moved = [i for i in range(len(rough[0])) if not all(identical(one[i], rough[0][i]) for one in rough)]
        if not moved:
            return []
        simulation = replace(self.case.simulation, solver=RK4)
        grids = [Grid.of(one, simulation, whole=self.case.problem.delay > 0) for one in signals]
        if any(len(one.starts) != len(grids[0].starts) or (one.starts != grids[0].starts).any() for one in grids):
            return None
        if any(one.cuts.tobytes() != grids[0].cuts.tobytes() for one in grids) or values[0] == 0:
            return None
        rows = [np.vstack([one.values.reshape(-1, len(rough[0])), one.last[None]])[:, moved] for one in grids]
        signs = rows[0] / values[0]
        fits = np.isin(signs, (-1, 0, 1)).all() and all((one == signs * v).all() for one, v in zip(rows, values, strict=True))
        return moved if fits else None


def _same_records(signals: Sequence[Signal], others: Sequence[Signal]) -> bool:
    """Whether signals that a page stores as points are the same in two cases."""
    pairs = zip(signals, others, strict=True)
    return all(identical(one, other) for one, other in pairs if isinstance(one, InterpolatedSignal))
