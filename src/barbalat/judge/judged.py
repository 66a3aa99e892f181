"""The verdicts on M runs, which follow from the judge's memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from barbalat.judge.memory import LEAST_RANGE, Memory
from barbalat.judge.settings import Bands
from barbalat.judge.verdict import Class, Cycle, Deviation, Figures, Response, Verdict
from barbalat.validate import Array

CLASSES = tuple(Class)
"""The classes, by their numbers in ``Judged.kinds``. The first that applies is the class of a run."""
TIE = 1e-9
"""Components whose errors relative to their bands differ by less than this count as equal, because the difference is rounding."""
LEAST_BESIDE = 1e-3
"""If the worst error is below this fraction of its band, only this component is reported, whichever state is declared to
follow."""


@dataclass(frozen=True, eq=False)
class Kept:
    """The judge's memory of M runs (rows, M), before the tail and for the whole run."""

    memory: Memory
    before_tail: Array
    whole: Array

    def of(self, name: str) -> Array:
        """Return a quantity (M, entries) of the whole run, or of the tail if it has separate rows for the tail."""
        return self.whole[self.memory.places[name]].T

    def in_tail(self, name: str) -> Array:
        """Return the increase of a count in the tail (M, entries)."""
        rows = self.memory.places[name]
        return np.asarray((self.whole[rows] - self.before_tail[rows]).T)

    @property
    def ranges(self) -> Array:
        """The range of each control (M, m); swings are judged relative to it."""
        return np.maximum(self.of("range"), self._roundings)

    @property
    def reversals(self) -> Array:
        """The reversals in the tail (M, m); 0 for a control that moves only by rounding."""
        return np.where(self.of("range") > self._roundings, self.in_tail("reversals"), 0.0)

    @property
    def swings(self) -> Array:
        """The path of each control between its turns in the tail (M, m), as a multiple of its range, with an error of at most
        one.

        The farthest points of two successive turns, each in the direction of its turn, add up to the path between them. If the
        number of turns is odd, the middle of the range is used twice, for the first and the last one.
        """
        direction = self.before_tail[self.memory.places["direction"]].T
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            odd = np.where(self.in_tail("reversals") % 2 == 1, direction * (self.of("low") + self.of("high")), 0.0)
            return np.asarray(np.where(self.reversals > 0, (2 * self.in_tail("turned at") - odd) / self.ranges, 0.0))

    @property
    def _roundings(self) -> Array:
        """The size of rounding errors over the whole run (M, m)."""
        extrema = [part[self.memory.places[name]] for part in (self.before_tail, self.whole) for name in ("low", "high")]
        magnitudes = np.abs(np.where(np.isfinite(extrema), extrema, 0.0))
        return np.asarray(LEAST_RANGE * magnitudes.max(axis=0).T)

    def of_inputs(self, name: str, which: tuple[bool, ...], *, in_tail: bool = False) -> Array:
        """Return the values (M, m) for inputs that have this quantity, and 0 for the others."""
        found = np.zeros((self.whole.shape[1], self.memory.inputs))
        found[:, np.flatnonzero(which)] = self.in_tail(name) if in_tail else self.of(name)
        return found


@dataclass(frozen=True, eq=False)
class Cycles:
    """The results for suspects: which controls cycle (M, m), with their amplitudes and frequencies [rad/s]; which members (M,)
    are suspects, which oscillate increasingly until the end of the windows, and which are lost there."""

    which: Array
    amplitude: Array
    frequency: Array
    suspect: Array
    growing: Array
    lost: Array

    @classmethod
    def none(cls, members: int, inputs: int, suspect: Array) -> Cycles:
        shape, nobody = (members, inputs), np.zeros(members, dtype=bool)
        return cls(np.zeros(shape, dtype=bool), np.zeros(shape), np.zeros(shape), suspect, nobody, nobody)


@dataclass(frozen=True, eq=False)
class Judged:
    """Verdicts on M runs of n components and m inputs.

    kinds          (M,) numbers of CLASSES
    error          (M, n) the tail's largest |e|, which is compared with ``bands``
    at_limit       (M, m) the fraction of the time for which each input is at its limits; ``at_rate_limit`` is the same for its
                   rate limit
    lost_at        (M,) the time by which each run was lost [s]; NaN if it was not lost
    lost_within    (M,) how much earlier this may have happened [s]
    dt, steps      the step [s] and the number of steps of the runs
    """

    kinds: Array
    bands: Bands
    error: Array
    cycles: Cycles
    at_limit: Array
    at_rate_limit: Array
    lost_at: Array
    kept: Kept
    dt: float
    steps: int
    lost_within: Array
    input_units: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        kept: Kept,
        bands: Bands,
        cycles: Cycles,
        *,
        lost_at: Array,
        lost_within: Array | None = None,
        diverged: Array,
        dt: float,
        steps: int,
        input_units: tuple[str, ...] = (),
    ) -> Judged:
        """Return the verdicts. ``diverged`` (M,) tells which runs diverged."""
        error, memory, instants = kept.of("largest e"), kept.memory, steps + 1
        with np.errstate(invalid="ignore"):
            lost = diverged | ~(kept.of("largest y") <= bands.lost).all(axis=1)
            follows = (error <= bands.follows).all(axis=1)
        cycling = cycles.which.any(axis=1)
        return cls(
            kinds=np.where(lost, 0, np.where(cycling, 1, np.where(follows, 3, 2))),
            bands=bands,
            error=error,
            cycles=cycles,
            at_limit=kept.of_inputs("at limit", memory.limited) / instants,
            at_rate_limit=kept.of_inputs("at rate limit", memory.rate_limited) / instants,
            lost_at=np.where(lost, lost_at, np.nan),
            lost_within=np.zeros(len(lost)) if lost_within is None else lost_within,
            kept=kept,
            dt=dt,
            steps=steps,
            input_units=input_units,
        )

    @classmethod
    def together(cls, parts: Sequence[Judged]) -> Judged:
        """Return the verdicts on all members of these parts, which share one structure and one simulation."""
        if len(parts) == 1:
            return parts[0]
        first = parts[0]
        scale, follows, lost = (_joined([getattr(part.bands, name) for part in parts]) for name in ("scale", "follows", "lost"))
        before, whole = (_joined([getattr(part.kept, name) for part in parts], 1) for name in ("before_tail", "whole"))
        cycles = {name: _joined([getattr(part.cycles, name) for part in parts]) for name in vars(first.cycles)}
        return replace(
            first,
            kinds=_joined([part.kinds for part in parts]),
            bands=replace(first.bands, scale=scale, follows=follows, lost=lost),
            error=_joined([part.error for part in parts]),
            cycles=Cycles(**cycles),
            at_limit=_joined([part.at_limit for part in parts]),
            at_rate_limit=_joined([part.at_rate_limit for part in parts]),
            lost_at=_joined([part.lost_at for part in parts]),
            lost_within=_joined([part.lost_within for part in parts]),
            kept=replace(first.kept, before_tail=before, whole=whole),
        )

    def __len__(self) -> int:
        return len(self.kinds)

    def count(self, kind: Class) -> int:
        """Return the number of runs of this class."""
        return int((self.kinds == CLASSES.index(kind)).sum())

    @property
    def worst(self) -> Array:
        """The component of each run (M,) that is worst relative to its band, or the first of several that are equal up to
        rounding."""
        return _worst(self.error, self.bands.follows)

    def verdict(self, i: int, settled: bool | None = None) -> Verdict:
        """Return the verdict on one run."""
        kind = CLASSES[self.kinds[i]]
        component, other = self._told(i, kind)
        lost_at, error = float(self.lost_at[i]), float(self.error[i, component])
        finite = np.isfinite(self.kept.whole[:, i]).all() if kind is Class.LOST else True
        return Verdict(
            kind=kind,
            component=self.bands.names[component],
            error=error if np.isfinite(error) and (kind is not Class.LOST or np.isfinite(self.error[i]).all()) else None,
            band=float(self.bands.follows[i, component]),
            scale=float(self.bands.scale[i, component]),
            unit=self.bands.units[component][1:-1],
            input_unit=self.input_units[self._cycling(i)] if self.input_units else "",
            settled=settled,
            cycle=self._cycle(i) if kind is Class.CYCLE else None,
            at_limit=tuple(np.nan_to_num(self.at_limit[i]).tolist()),
            at_rate_limit=tuple(np.nan_to_num(self.at_rate_limit[i]).tolist()),
            lost_at=lost_at if np.isfinite(lost_at) else None,
            lost_within=float(self.lost_within[i]) if np.isfinite(lost_at) else 0.0,
            lost_when_held=bool(self.cycles.lost[i]) and kind in (Class.OFF, Class.FOLLOWS),
            bands=self.bands.said(i),
            figures=self._figures(i) if self.kept.memory.detailed and kind is not Class.LOST and finite else None,
            beside=None if other is None else self._deviation(i, other),
        )

    def _told(self, i: int, kind: Class) -> tuple[int, int | None]:
        """Return the component that a verdict names first and the one that it adds, if any."""
        worst, declared = int(self.worst[i]), list(self.bands.declared)
        if not declared or kind is Class.LOST:
            return worst, None
        first = declared[int(_worst(self.error[i : i + 1, declared], self.bands.follows[i : i + 1, declared])[0])]
        if first == worst or self.error[i, worst] <= LEAST_BESIDE * self.bands.follows[i, worst]:
            return worst, None
        return (worst, first) if kind is Class.OFF and self.error[i, first] <= self.bands.follows[i, first] else (first, worst)

    def _deviation(self, i: int, component: int) -> Deviation:
        return Deviation(
            component=self.bands.names[component],
            error=float(self.error[i, component]),
            band=float(self.bands.follows[i, component]),
            scale=float(self.bands.scale[i, component]),
            unit=self.bands.units[component][1:-1],
        )

    def _cycling(self, i: int) -> int:
        """Return the input whose cycle is largest relative to its range."""
        share = np.where(self.cycles.which[i], self.cycles.amplitude[i] / self.kept.ranges[i], -1.0)
        return int(share.argmax())

    def _cycle(self, i: int) -> Cycle:
        j = self._cycling(i)
        amplitude, frequency = float(self.cycles.amplitude[i, j]), float(self.cycles.frequency[i, j])
        return Cycle(signal=f"u_limited[{j}]", amplitude=amplitude, frequency=frequency)

    def _figures(self, i: int) -> Figures:
        def of(name: str) -> tuple[float, ...]:
            return tuple(map(float, self.kept.of(name)[i]))

        return Figures(
            IAE=tuple(self.dt * value for value in of("IAE")),
            ITAE=tuple(self.dt**2 * value for value in of("ITAE")),
            activity=of("path"),
            reversals=tuple(map(int, of("reversals"))),
            responses=self._responses(i) if self.kept.memory.gains else {},
        )

    def _responses(self, i: int) -> dict[str, Response]:
        """Return the step responses of the components that the command moves."""
        found = {}
        for j, name in enumerate(self.bands.names):
            if not any(self.kept.memory.gains[j]):
                continue

            def of(name: str, component: int = j) -> float:
                return float(self.kept.of(name)[i, component])

            risen = of("never risen") + of("rising") == 0
            settled = of("never settled") + of("outside") == 0
            found[name] = Response(
                RiseTime=self.dt * of("rise") if risen else None,
                SettlingTime=self.dt * of("settling") if settled else None,
                Overshoot=100 * of("overshoot"),
            )
        return found


def _joined(parts: Sequence[Array], axis: int = 0) -> Array:
    return np.concatenate(parts, axis=axis)


def _worst(error: Array, bands: Array) -> Array:
    """Return the index (M,) of the largest ratio of errors to bands (M, k), or of the first of several that are equal up to
    rounding."""
    with np.errstate(divide="ignore", invalid="ignore"):
        against = np.where(error > 0, error / bands, 0.0)
    against = np.nan_to_num(against, nan=np.inf)
    return np.asarray((against >= (1 - TIE) * against.max(axis=1, keepdims=True)).argmax(axis=1))
