"""Test vectors selected for the faults that they detect: single samples from states that a simulation may never reach.

Candidates are drawn around the samples of the simulation. They are scaled states, states at rest, states with zeros of either
sign, estimates on the faces of the known set, frozen states, and states before the first sample. For each comparison in the list,
candidates at which its sides are equal or neighbouring numbers are found by bisection. A candidate is kept if it detects a mutant
of the list that no earlier vector detected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from barbalat.export.acceptance import Order, numbers
from barbalat.export.contents import Contents
from barbalat.export.equivalence import CASES, MORE_CASES, Interval, Prover
from barbalat.export.evaluation import evaluate, values
from barbalat.export.mutants import Judge, Mutant, mutants
from barbalat.export.parameters import Parameter
from barbalat.export.shell import held_in_range, in_own_range
from barbalat.export.source import ESTIMATE_TOLERANCE
from barbalat.loop.true_values import estimate_set
from barbalat.lowering.operations import sources
from barbalat.run.kernel.sampled_controller import COMMAND, FREEZE, MEASURED, PARAMETER, STATE
from barbalat.validate import Array

ROUNDS = 40
"""Largest number of rounds of candidates; together with the next constants, it is the budget of the search."""
WORK = 12000
"""Operations of the list times rounds after which the search of a long list ends, after at least ten rounds."""
MORE_ROUNDS = 40
"""Further rounds, with ``MORE_PAIRS`` times as many pairs, if more than the fraction ``WEAK`` of the mutants are undecided."""
WEAK, MORE_PAIRS = 0.03, 4
FEW = 20
"""Largest number of remaining mutants for which proofs are attempted again with a larger budget."""
PROVEN_AFTER = 2
"""Number of rounds after which proofs are attempted for the remaining mutants."""
CANDIDATES = 384
"""Number of candidates in a round."""
PAIRS = 6
"""Number of pairs, in every second round, between which the sides of a comparison are made equal."""
BEGUN = 6
"""Number of columns per round whose neighbours become candidates of the next round; at these columns a remaining fault changes a
value."""
WIDE = 7.0
"""Decades by which the entries of some columns are scaled, for steps far outside the known set, where rounding in the
projection matters."""
HALVINGS = 64
"""Number of bisections between the two columns of a pair: more than a number has bits."""
TOLERATED = ESTIMATE_TOLERANCE / 2
"""Relative distance by which an estimate may be outside its set here: half of what the exported C tolerates."""
COMPARED = {"lt", "le", "eq", "ne", "fmin", "fmax"}


@dataclass(frozen=True, eq=False)
class Vectors:
    """Single samples, one per column, and the faults that they detect.

    states    (S, D) flat states before the sample
    measured, commands  (y, D), (q, D)
    parameters  (P, D) parameters that are set
    freeze    (D,)
    after     (S, D) flat states after the sample
    mutants   mutants of the list
    missed    mutants that are detected neither by these samples nor by those of the simulation, each with the proof of its
              equivalence, or an empty text
    missed_by_the_run  mutants that are not detected by the samples of the simulation
    outcomes  outcomes of choices in the list: the number taken by these and the simulation's samples, and the total
    """

    states: Array
    measured: Array
    commands: Array
    parameters: Array
    freeze: Array
    after: Array
    mutants: tuple[Mutant, ...]
    missed: dict[Mutant, str]
    missed_by_the_run: tuple[Mutant, ...]
    outcomes: tuple[int, int]

    def counted(self, *, ties: bool) -> tuple[int, int, int]:
        """The numbers of mutants, of detected mutants and of mutants proven equivalent, either among those that differ only at
        ties or among all others."""
        missed = {mutant: proof for mutant, proof in self.missed.items() if mutant.tie == ties}
        count = sum(mutant.tie == ties for mutant in self.mutants)
        return count, count - len(missed), sum(map(bool, missed.values()))


@lru_cache(maxsize=2)
def chosen(contents: Contents) -> Vectors:
    """The vectors of one export; repeated calls give the same vectors."""
    return _Search(contents).run()


def _faults(left: Sequence[Mutant]) -> int:
    """The number of mutants that differ not only at ties."""
    return sum(not one.tie for one in left)


class _Search:
    def __init__(self, contents: Contents) -> None:
        self.contents, self.random = contents, np.random.default_rng(0)
        self.rows, self.numbers = contents.layout.rows, contents.real.numbers
        vectors = contents.vectors
        before = np.vstack([contents.initial, vectors.states[:-1]])[:, self.rows]
        self.set = np.array([[one.value] for one in contents.parameters]).reshape(-1, 1)
        given = np.broadcast_to(self.set, (len(self.set), len(before)))
        self.nominal = np.vstack([before.T, vectors.measured.T, vectors.commands.T, given, np.zeros(len(before))])
        self.found = self.begun = self.nominal[:, :0]
        y, q, _, _ = contents.sizes
        s = len(self.rows)
        self.ends = s, s + y, s + y + q
        self.place = {row: i for i, row in enumerate(self.rows)}
        self.sizes = np.abs(self.nominal).max(axis=1, keepdims=True) + 1e-3

    def _split(self, columns: Array) -> tuple[Array, Array, Array, Array, Array]:
        s, y, q = self.ends
        states = np.zeros((len(self.contents.initial), columns.shape[1]))
        states[self.rows] = columns[:s]
        return states, columns[s:y], columns[y:q], columns[-1], columns[q:-1]

    def _judge(self, columns: Array) -> Judge:
        contents = self.contents
        return Judge(contents.step, self.rows, contents.inputs(*self._split(columns)), contents.real)

    def run(self) -> Vectors:
        contents = self.contents
        every = mutants(contents.step, self.rows, contents.real)
        judge = self._judge(self.nominal)
        left = [one for one in every if not judge.tell(one).any()]
        at_first, kept, proofs = tuple(left), [np.zeros((len(self.nominal), 0))], dict[Mutant, str]()
        number = 0
        most = min(ROUNDS, max(10, WORK // len(contents.step.operations)))
        while _faults(left) and number < most + (MORE_ROUNDS if self._is_weak(every, left, proofs) else 0):
            pool = self._usable(self._drawn() if number else self._special())
            if number % 2:
                pool = np.hstack([pool, self._usable(self._bisected(pool, PAIRS if number < most else PAIRS * MORE_PAIRS))])
            pool = np.hstack([pool, self._usable(self._neighbours())])
            best, rest = self._covering(pool, left)
            kept.append(best)
            self.found = np.hstack(kept)
            number, left = number + 1, rest
            if number == PROVEN_AFTER:
                proofs = self._proofs(left)
                left = [one for one in left if one not in proofs]
        if number > PROVEN_AFTER and _faults(left) <= FEW:
            proofs |= self._proofs(left, MORE_CASES)
            left = [one for one in left if one not in proofs]
        columns = np.hstack(kept)
        states, measured, commands, freeze, given = self._split(columns)
        after = np.zeros_like(states)
        after[self.rows] = evaluate(contents.step, contents.inputs(*self._split(columns)), contents.real)
        missed = proofs | dict.fromkeys(left, "")
        outcomes = self._judge(np.hstack([self.nominal, columns])).outcomes()
        return Vectors(states, measured, commands, given, freeze, after, every, missed, at_first, outcomes)

    def _is_weak(self, every: Sequence[Mutant], left: Sequence[Mutant], proofs: dict[Mutant, str]) -> bool:
        """Whether the score is too small: the fraction of mutants that are detected, among those that are not proven
        equivalent."""
        return _faults(left) > WEAK * (_faults(every) - _faults(list(proofs)))

    def _proofs(self, left: Sequence[Mutant], most_cases: int = CASES) -> dict[Mutant, str]:
        """The mutants, among the given ones, that are proven equivalent."""
        contents, most = self.contents, float(self.numbers(self.contents.range))
        y, q, _, _ = contents.sizes
        anything = Interval(-most, most)
        within = {(STATE, row): anything for row in self.rows} | {(FREEZE, 0): Interval(0.0, contents.lost)}
        within |= {(MEASURED, i): anything for i in range(y)} | {(COMMAND, i): anything for i in range(q)}
        if contents.checked_limits is not None:
            for row, low, high in zip(
                contents.layout.theta_hat.rows, *map(np.ndarray.tolist, contents.checked_limits), strict=True
            ):
                taken = low - ESTIMATE_TOLERANCE * (1 + abs(low)), high + ESTIMATE_TOLERANCE * (1 + abs(high))
                ends = tuple(float(self.numbers(end)) for end in taken)  # as in the C code
                within[STATE, row] = Interval(max(-most, ends[0]), min(most, ends[1]))
        within |= {at: self._interval(contents.fed(at[1])) for at in sources(contents.step) if at[0] == PARAMETER}
        prover = Prover(contents.step, within, contents.real, self.rows, most_cases, self._ordered())
        last_first = sorted(
            left, key=lambda one: -one.place
        )  # first the faults on which few operations depend, because their proofs are cheap
        found = {one: proof for one in last_first if (proof := prover.proof(one))}
        return {one: found[one] for one in left if one in found}

    def _ordered(self) -> list[tuple[tuple[int, int], tuple[int, int]]]:
        """Pairs of list inputs that are parameters and whose first member is at most the second."""
        contents, at = self.contents, dict[float, list[tuple[int, int]]]()
        for kind, entry in sources(contents.step):
            if kind == PARAMETER and not isinstance(one := contents.fed(entry), float):
                at.setdefault(contents.parameters.index(one), []).append((kind, entry))
        pairs = {one.entries for one in contents.conditions if isinstance(one, Order) and numbers(one) == set(one.entries)}
        while longer := {(a, d) for a, b in pairs for c, d in pairs if b == c} - pairs:
            pairs |= longer
        return [(a, b) for low, high in sorted(pairs) for a in at.get(low, []) for b in at.get(high, [])]

    def _interval(self, one: Parameter | float) -> Interval:
        """The admissible values of a parameter; for a fixed number, its value."""
        if isinstance(one, float):
            return Interval(float(self.numbers(one)), float(self.numbers(one)))
        most = float(self.numbers(self.contents.parameter_range))
        low, high = self.contents.bounds(self.contents.parameters.index(one))
        return Interval(max(-most, low), min(most, high))

    def _covering(self, pool: Array, left: Sequence[Mutant]) -> tuple[Array, list[Mutant]]:
        """A small number of columns that detect all mutants that the pool detects, and the undetected mutants."""
        judge = self._judge(pool)
        told = np.array([judge.tell(one) for one in left])
        rest = [one for one, row in zip(left, told, strict=True) if not row.any()]
        begun = [np.flatnonzero(judge.begins(one)) for one in rest if not one.tie]
        again = [self.random.choice(at, BEGUN) for at in begun if len(at)]
        if again:
            self.begun = pool[:, self.random.permutation(np.concatenate(again))[: CANDIDATES // 4]]
        told, picked = told[told.any(axis=1)], []
        while len(told):
            at = int(np.argmax(told.sum(axis=0)))
            picked.append(at)
            told = told[~told[:, at]]
        return pool[:, picked], rest

    def _usable(self, columns: Array) -> Array:
        """The columns that are in range and lead to a state in range."""
        contents = self.contents
        columns = columns.astype(self.numbers).astype(float)
        with np.errstate(all="ignore"):
            after = evaluate(contents.step, contents.inputs(*self._split(columns)), contents.real).astype(float)
        after = np.broadcast_to(after.reshape(len(self.rows), -1), (len(self.rows), columns.shape[1]))
        good = (np.abs(columns) <= contents.range).all(axis=0) & (np.abs(after) <= contents.range).all(axis=0)
        good &= contents.takes(columns[self.ends[2] : -1])
        if contents.around is not None:  # only columns that the case's shell accepts
            around, checked, always = contents.around, held_in_range(contents), in_own_range(contents)
            for ends, part, limits in (
                (self.ends[:2], contents.layout.measured, (around.low, around.high, around.rate)),
                (self.ends[1:], contents.layout.r, (around.command_low, around.command_high, around.command_rate)),
            ):
                now, last = columns[slice(*ends)], columns[[self.place[row] for row in part.rows]]
                low, high, rate = (limit[:, None] for limit in limits)
                good &= ((now >= low) & (now <= high) & (np.abs(now - last) <= rate * (1 - TOLERATED))).all(axis=0)
                if part.name in always or not np.isfinite(rate).any():
                    at = list(checked[part.name])
                    good &= ((last[at] >= low[at]) & (last[at] <= high[at])).all(axis=0)
        if contents.checked_limits is not None:
            at = [self.place[row] for row in contents.layout.theta_hat.rows]
            low, high = (
                limit[:, None] + sign * TOLERATED * (1 + np.abs(limit[:, None]))
                for sign, limit in zip((-1, 1), contents.checked_limits, strict=True)
            )
            for estimates in (columns[at], after[at]):
                good &= ((estimates >= low) & (estimates <= high)).all(axis=0)
        return columns[:, good]

    def _special(self) -> Array:
        """Columns in which all entries, or all except one, are zero of either sign."""
        count = CANDIDATES // 2
        columns = np.zeros((len(self.nominal), count))
        columns[self.random.random(columns.shape) < 0.5] = -0.0
        kept = self.nominal[:, self.random.integers(0, self.nominal.shape[1], count)]
        chance = self.random.choice([0.0, 0.05, 0.2, 0.5], size=count)
        columns = np.where(self.random.random(columns.shape) < chance, kept, columns)
        columns[-1] = self._frozen(count, 0.2)
        return self._of_sets(columns, kept)

    def _drawn(self) -> Array:
        """Columns near samples of the simulation."""
        random, count = self.random, CANDIDATES
        columns = self.nominal[:, random.integers(0, self.nominal.shape[1], count)].copy()
        shape = columns.shape
        if self.found.shape[1]:
            again = self.found[:, random.integers(0, self.found.shape[1], count)]
            columns = np.where(random.random(count) < 0.4, again, columns)
        base = columns
        moved = random.random(shape) < random.choice([0.0, 0.3, 1.0], size=count)
        columns = np.where(moved, self.sizes * random.uniform(-1, 1, shape), columns)
        scaled = random.random(shape) < random.choice([0.0, 0.2, 0.6], size=count)
        decades = random.choice([3.0, 3.0, 3.0, WIDE], size=count)
        columns = np.where(scaled, columns * 10.0 ** (decades * random.uniform(-1, 1, shape)), columns)
        columns *= 10.0 ** np.where(random.random(count) < 0.4, random.uniform(-2, 2, count), 0.0)
        none = random.random(shape) < random.choice([0.0, 0.0, 0.1, 0.5], size=count)
        columns = np.where(none, np.where(random.random(shape) < 0.5, 0.0, -0.0), columns)
        columns[-1] = self._frozen(count, 0.15)
        return self._of_sets(columns, base)

    def _frozen(self, count: int, share: float) -> Array:
        """The freeze switch, which is on in this fraction of the columns; with an observer, it has two values for "on"."""
        found, lost = (self.random.random(count) < share).astype(float), self.contents.lost
        return found if lost == 1 else found * self.random.choice([1.0, lost], size=count)

    def _neighbours(self) -> Array:
        """Columns near those at which a fault changes a value without changing an output; some differ only in the last bits."""
        random, columns = self.random, np.tile(self.begun, 4)
        size = 10.0 ** random.uniform(-17, 0, columns.shape[1])
        moved = random.random(columns.shape) < random.choice([0.1, 0.5, 1.0], size=columns.shape[1])
        moved[-1] = False  # frozen or not
        return np.where(moved, columns * (1 + size * random.normal(size=columns.shape)), columns)

    def _of_sets(self, columns: Array, drawn_of: Array) -> Array:
        """The columns with the necessary properties: estimates in their set or on its faces, symmetric matrices, and a flag that
        is either started or not."""
        random, layout, count, before = self.random, self.contents.layout, columns.shape[1], drawn_of
        for part in layout.parts:
            at = [self.place[row] for row in part.rows]
            if part is layout.theta_hat:
                columns[at] = np.where(random.random(count) < 0.8, self._estimates(columns[at]), self._within(columns[at]))
            elif part is layout.started:
                columns[at] = random.choice([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, -0.0], size=(1, count))
            elif len(part.shape) == 2 and part.shape[0] == part.shape[1] > 1:
                columns[at] = np.where(random.random(count) < 0.7, self._matrices(at, part.shape[0], count), before[at])
        last, now = layout.measured, slice(self.ends[0], self.ends[1])
        same = random.random(count) < 0.15
        values = np.where(random.random(count) < 0.3, 1.0, columns[now][:1])
        columns[now] = np.where(same, np.where(random.random(columns[now].shape) < 0.3, -values, values), columns[now])
        same &= random.random(count) < 0.7
        rows = [self.place[row] for row in last.rows]
        columns[rows] = np.where(same, columns[now], columns[rows])
        shape, slow = columns[now].shape, random.random(count) < 0.4  # with a nearly correct predictor: small errors
        for part in layout.parts:
            if part.shape == last.shape and part not in (layout.u, layout.theta_hat):
                near = columns[now] * (1 + 10.0 ** random.uniform(-6, 0, count) * random.normal(size=shape))
                at = [self.place[row] for row in part.rows]
                columns[at] = np.where(slow, near, columns[at])
        same = random.random(count) < 0.1
        columns[now] = np.where(same, columns[[self.place[row] for row in last.rows]], columns[now])
        columns[self.ends[2] : -1] = self._parameters(count)
        return self._at_zero(columns)

    def _at_zero(self, columns: Array) -> Array:
        """The columns, in some of which parameters that bound others, and estimates that they bound, are zeros of either sign. At
        a bound of zero a fault may change the sign of a zero only."""
        order = (one for one in self.contents.conditions if isinstance(one, Order) and not one.strict)
        bounds = sorted({i for one in order if numbers(one) == set(one.entries) for i in numbers(one)})
        if not bounds or self.contents.opened is None:
            return columns
        random, count = self.random, columns.shape[1]
        limited = zip(self.contents.layout.theta_hat.rows, self.contents.opened.open_limits.any(axis=0), strict=False)
        at = [*(self.ends[2] + i for i in bounds), *(self.place[row] for row, is_open in limited if is_open)]
        none = random.random((len(at), count)) < random.choice([0.0, 0.5, 1.0], p=[0.9, 0.05, 0.05], size=count)
        columns[at] = np.where(none, np.where(random.random(none.shape) < 0.5, 0.0, -0.0), columns[at])
        return columns

    def _parameters(self, count: int) -> Array:
        """Parameters of the case, some of them changed slightly or strongly, or set to a zero of either sign."""
        if not len(self.set):
            return np.zeros((0, count))
        random, shape = self.random, (len(self.set), count)
        moved = random.random(shape) < random.choice([0.0, 0.2, 1.0], size=count)
        factor = 10.0 ** (random.uniform(-1, 1, shape) * random.choice([0.05, 1.0, 2.0], size=count))
        drawn = np.where(self.set == 0, random.normal(size=shape), self.set * factor)
        drawn = np.where(moved, drawn, self.set)
        free = np.array([[self.contents.bounds(i) == (-np.inf, np.inf)] for i in range(len(self.set))])
        none = free & (random.random(shape) < random.choice([0.0, 0.0, 0.3], size=count))
        return np.where(none, np.where(random.random(shape) < 0.5, 0.0, -0.0), drawn)

    def _matrices(self, at: list[int], n: int, count: int) -> Array:
        """Symmetric positive definite matrices, like covariances, from almost zero to large and nearly singular."""
        random = self.random
        base = self.nominal[at][:, random.integers(0, self.nominal.shape[1], count)]
        size = np.abs(base).max(axis=0)
        v = random.normal(size=(n, count)) * 10.0 ** random.uniform(-2, 3, count)
        more = (v[:, None] * v[None]).reshape(n * n, count) * size * (random.random(count) < 0.5)
        scale = np.where(random.random(count) < 0.5, 1.0, 10.0 ** random.uniform(-4, 2, count))
        return (base + more) * scale

    def _within(self, columns: Array) -> Array:
        """Estimates moved into the intervals of their set."""
        limits = self.contents.limits
        return columns if limits is None else np.clip(columns, *(limit[:, None] for limit in limits))

    def _estimates(self, columns: Array) -> Array:
        limits, random = self.contents.limits, self.random
        if limits is None:
            return columns
        low, high = (np.where(np.isfinite(limit), limit, np.nan)[:, None] for limit in limits)
        shape = columns.shape
        inside = low + random.random(shape) * (high - low)
        face = np.where(random.random(shape) < 0.5, low, high)
        kind = random.random(shape) + random.choice([-0.2, 0.0, 0.3], size=shape[1])
        found = np.where(kind < 0.35, inside, np.where(kind < 0.7, np.clip(columns, low, high), face))
        alike = low + (high - low) * random.choice([0.0, 0.25, 0.5, 0.75, 1.0, 0.9], size=shape[1])  # creates ties
        found = np.where(random.random(shape[1]) < 0.15, alike, found)
        one_sided = np.where(np.isnan(low), np.where(np.isnan(high), columns, high - np.abs(columns)), low + np.abs(columns))
        found = np.where(np.isnan(found), one_sided, found)
        beyond = (random.random(shape) < 0.3) & (random.random(shape[1]) < 0.1)
        found = np.where(beyond, found + np.sign(found) * TOLERATED / 2, found)
        sphere = getattr(estimate_set(self.contents.loop), "sphere", None)
        if sphere is not None:
            n = sphere.size
            away = found[:n] - sphere.center[:, None]
            length = np.sqrt((away * away).sum(axis=0)) + 1e-300
            wanted = np.where(random.random(shape[1]) < 0.5, 1.0, random.random(shape[1])) * sphere.radius
            found[:n] = np.where(length > sphere.radius, sphere.center[:, None] + away * (wanted / length), found[:n])
        return found

    def _beyond(self, pool: Array) -> Array:
        """Some of these columns with all estimates outside their set by the amount that is accepted as rounding."""
        limits, random = self.contents.limits, self.random
        if limits is None or not np.isfinite(limits).all():
            return pool
        at, pool = [self.place[row] for row in self.contents.layout.theta_hat.rows], pool.copy()
        low, high = (limit[:, None] + sign * TOLERATED / 2 for sign, limit in zip((-1, 1), limits, strict=True))
        outside = np.where(random.random((len(at), pool.shape[1])) < 0.5, low, high)
        pool[at] = np.where(random.random(pool.shape[1]) < 0.3, outside, pool[at])
        return pool

    def _bisected(self, pool: Array, pairs: int = PAIRS) -> Array:
        """For each comparison, columns at which its sides are equal or as close as numbers allow."""
        operations, random = self.contents.step.operations, self.random
        pool = self._beyond(pool)
        places = [i for i, op in enumerate(operations) if op.name in COMPARED]
        if not places or pool.shape[1] < 2:
            return pool[:, :0]
        found = self._differences(pool, np.repeat(places, pool.shape[1]), tiled=len(places)).reshape(len(places), -1)
        ones, others, of = list[int](), list[int](), list[int]()
        for place, row in zip(places, found, strict=True):
            for frozen in (0.0, 0.0, 1.0):
                below, above = (np.flatnonzero(side & (pool[-1] == frozen)) for side in (row <= 0, row > 0))
                for _ in range(pairs // 3 if len(below) and len(above) else 0):
                    ones.append(int(random.choice(below)))
                    others.append(int(random.choice(above)))
                    of.append(place)
        if not of:
            return pool[:, :0]
        low, high, of_array = pool[:, ones], pool[:, others].copy(), np.array(of)
        moved = random.random(low.shape) < random.choice([0.1, 0.3, 1.0], size=low.shape[1])
        start = np.where(moved, high, low)
        apart = self._differences(start, of_array) > 0
        high, of_array, low = start[:, apart], of_array[apart], low[:, apart]
        for _ in range(HALVINGS):
            middle = ((low + high) / 2).astype(self.numbers).astype(float)
            above = self._differences(middle, of_array) > 0
            ends = np.where(above, middle, high), np.where(above, low, middle)
            if all(map(np.array_equal, ends, (high, low))):
                break  # no number lies between them
            high, low = ends
        return np.hstack([low, high])

    def _differences(self, columns: Array, of: Array, tiled: int = 1) -> Array:
        """For each column, the first side of its comparison minus the second."""
        contents = self.contents
        found = values(contents.step, contents.inputs(*self._split(columns)), contents.real)
        count = columns.shape[1] * tiled
        made = np.full(count, -np.inf)
        for place in np.unique(of):
            at = of == place
            first, second = (np.asarray(found[i], dtype=float) for i in contents.step.operations[place].operands)
            with np.errstate(all="ignore"):
                difference = np.broadcast_to(first - second, columns.shape[1])
            made[at] = (np.tile(difference, tiled) if tiled > 1 else difference)[at]
        return np.nan_to_num(made, nan=-np.inf)
