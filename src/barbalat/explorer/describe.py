"""Everything that a page knows of a case, as data: modules, the numbers that go into them, what their outputs are."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from barbalat.cases.build import Case
from barbalat.explorer.commands import Grid, breaks_anywhere, is_smooth, smooth_module, steps_offered
from barbalat.explorer.effects import Effect, Rows, Target, composed, effects_of
from barbalat.explorer.numbers import GRID, Number, ranged
from barbalat.explorer.source import Source
from barbalat.loop.packing import unflatten
from barbalat.loop.true_values import true_values
from barbalat.lowering.wasm.loop import loop as module_of
from barbalat.problem.command_gain import commanded, gains_at_rest
from barbalat.run.columns import Columns
from barbalat.run.members import Members
from barbalat.run.metrics import Accumulators
from barbalat.solvers import RK4, SOLVERS
from barbalat.solvers.simulation import Simulation
from barbalat.sweeps.paths import FieldPath
from barbalat.validate import Array, InputError

MOST_NUMBERS = 80
"""Sliders of a page."""
PRECEDENCE = ("controller", "reference", "simulation", "plant", "reference_model", "uncertainty", "")
"""Which of two numbers gets a slider, where both move one row of a module: that of the part that stands first,
and of a part's a number by itself before entries of vectors."""
MOST_STEPS = 4_000_000
"""Of a run in a page: its table of commands takes 100 MB then."""


SETTINGS_TRIED = 12
"""Near the case, and as many over the sliders' whole length."""
Followed = list[tuple[Number, list[Effect], list[int]]]
"""Numbers with sliders, their effects on each kernel, and the entries of the smooth signals' numbers that they are."""


def doubles(values: Array) -> str:
    """Numbers as a page reads them: base64 of little-endian doubles."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode()


@dataclass(frozen=True, eq=False)
class Described:
    """A case as its page has it.

    toggles  the controllers whose projection can be switched
    """

    source: Source
    case: Case
    toggles: tuple[int, ...]

    @classmethod
    def of(cls, source: Source) -> Described:
        """InputError for a case that no page can simulate yet."""
        case = source.at({})
        if case.problem.noise is not None:
            raise InputError("a page has no measurement noise yet: leave sensor.noise out, or simulate with barbalat run")
        if case.problem.delay > 0:
            raise InputError("a page has no delay at the plant's input yet: set it to 0, or simulate with barbalat run")
        return cls(source, case, tuple(i for i in range(len(case.controllers)) if _switches(source, case, i)))

    @cached_property
    def variants(self) -> list[tuple[int, bool, Target]]:
        """Every controller, those that can be switched both ways: index, whether it is switched, its kernel."""
        found = [(i, False, Target.of(self.case, i, self.case.simulation)) for i in range(len(self.case.controllers))]
        switched = self.source.at({}, self.toggles)
        return found + [(i, True, Target.of(switched, i, switched.simulation)) for i in self.toggles]

    @cached_property
    def numbers(self) -> Followed:
        """Those with sliders, their effects on the variants, and the entries of the smooth signals' numbers that they are."""
        taken: list[Rows] = [set() for _ in self.variants]
        kept: Followed = []
        for path, value in sorted(self.source.numbers(), key=_precedence):
            if path.keys[-1] in GRID or len(kept) == MOST_NUMBERS:
                continue
            number = ranged(path, value, partial(self._at, ()))
            found = None if number is None else self._followed(number, taken)
            if found is not None:
                kept.append(found)
                taken = [rows | effect.rows for effect, rows in zip(found[1], taken, strict=True)]
        while not self._composes(kept):
            tabulated = [k for k, (_, effects, _) in enumerate(kept) if any(effect.table is not None for effect in effects)]
            kept.pop(tabulated[-1])
        return kept

    def _composes(self, kept: Followed) -> bool:
        """Whether settings of all numbers at once are what their effects are one by one; a product of two would not be."""
        draw = np.random.default_rng(0)
        for share in np.repeat((0.1, 1.0), SETTINGS_TRIED):
            places = [_drawn(number, share, draw) for number, _, _ in kept]
            values = [float(number.values[place]) for (number, _, _), place in zip(kept, places, strict=True)]
            try:
                case = self.source.at({number.path: v for (number, _, _), v in zip(kept, values, strict=True)})
            except InputError:  # together they make no case: the copied one says why
                continue
            for k, (_, switched, target) in enumerate(self.variants):
                if not switched and not _agrees(target, case, composed(target, [e[k] for _, e, _ in kept], values, places)):
                    return False
        return True

    def _followed(self, number: Number, taken: Sequence[Rows]) -> tuple[Number, list[Effect], list[int]] | None:
        places = self._in_signals(number)
        if places is None:
            return None
        effects: list[Effect] = []
        for toggled in ((), self.toggles) if self.toggles else ((),):
            which = [k for k, (_, switched, _) in enumerate(self.variants) if switched == bool(toggled)]
            targets, rows = [self.variants[k][2] for k in which], [taken[k] for k in which]
            found = effects_of(number, targets, rows, partial(self._at, toggled))
            if found is None or (effects and len(found[0].values) != len(number.values)):
                return None
            number, effects = found[0], effects + found[1]
        return (number, effects, places) if places or not all(effect.nothing for effect in effects) else None

    def _at(self, toggled: Sequence[int], path: FieldPath, value: float) -> Case:
        return self.source.at({path: value}, toggled)

    def _in_signals(self, number: Number) -> list[int] | None:
        """Where it stands among the smooth signals' numbers; None where signals follow from it in another way."""
        tried = [self.case, *(self.source.at({number.path: float(v)}) for v in (number.values[0], number.values[-1]))]
        signals = [case.problem.signals for case in tried]
        if all(one == signals[0] for one in signals):
            return []
        rough = [tuple(signal for signal in one if not is_smooth(signal)) for one in signals]
        if any(one != rough[0] for one in rough) or breaks_anywhere([s for s in signals[0] if is_smooth(s)]):
            return None
        columns = Columns(tuple(signal for signal in signals[0] if is_smooth(signal)))
        for one in signals[1:]:
            columns.add(tuple(signal for signal in one if is_smooth(signal)))
        values = columns.everything()
        moved = np.flatnonzero((values != values[:, :1]).any(axis=1))
        tried_values = [number.value, number.values[0], number.values[-1]]
        return [int(i) for i in moved] if (values[moved] == tried_values).all() else None

    def as_data(self) -> dict[str, Any]:
        """For the page's JSON."""
        problem, simulation = self.case.problem, self.case.simulation
        module, values = smooth_module(problem.signals)
        numbers = self.numbers
        return {
            "case": problem.name,
            "simulation": {
                "t_end": simulation.t_end, "dt": simulation.dt, "solver": simulation.solver.name,
                "record_points": simulation.record_points, "most_steps": MOST_STEPS,
            },
            "solvers": {name: list(tableau.nodes) for name, tableau in SOLVERS.items()},
            "signals": {
                "module": base64.b64encode(module).decode(), "parameters": doubles(values),
                "smooth": [is_smooth(signal) for signal in problem.signals],
                "grids": self._grids() if breaks_anywhere(problem.signals) else None,
            },
            "numbers": [
                {
                    "path": str(number.path), "label": number.label, "group": _group_name(number, self.case),
                    "value": number.value, "values": doubles(number.values), "whole": number.whole,
                    "log": number.logarithmic, "signals": places, "copied": all(e.table is None for e in effects),
                }
                for number, effects, places in numbers
            ],
            "controllers": [self._controller(i) for i in range(len(self.case.controllers))],
            "case_file": self.source.case_file(self._slots(numbers), self.toggles),
            "toggles": list(self.toggles),
        }  # fmt: skip

    def _slots(self, numbers: Sequence[tuple[Number, list[Effect], list[int]]]) -> list[FieldPath]:
        return [*(number.path for number, _, _ in numbers), *(FieldPath(("simulation", key)) for key in GRID)]

    def _grids(self) -> list[dict[str, Any]]:
        """All for one kind of kernel: with steps in pieces, or without."""
        signals, own = self.case.problem.signals, self.case.simulation
        grids = [Grid.of(signals, replace(one, solver=RK4)) for one in steps_offered(own) if one.steps <= MOST_STEPS]
        (case_grid,) = (grid for grid in grids if grid.simulation.dt == own.dt)
        return [
            {
                "dt": grid.simulation.dt, "cuts": doubles(grid.cuts), "starts": grid.starts.tolist(),
                "values": doubles(grid.values), "last": doubles(grid.last),
            }
            for grid in grids
            if bool(len(grid.cuts)) == bool(len(case_grid.cuts))
        ]  # fmt: skip

    def _controller(self, i: int) -> dict[str, Any]:
        variants = {}
        for k, (index, switched, target) in enumerate(self.variants):
            if index == i:
                asked = self.source.projected(i) != switched
                variants["on" if asked else "off"] = self._variant(k, target)
        target = self.variants[i][2]
        return {
            "name": self.case.controllers[i].name, "projection": "on" if self.source.projected(i) else "off",
            "variants": variants, **_outputs(self.case, target.family.members),
        }  # fmt: skip

    def _variant(self, k: int, target: Target) -> dict[str, Any]:
        effects = [(j, found[k]) for j, (_, found, _) in enumerate(self.numbers)]
        return {
            "parameters": doubles(target.base.parameters[:, 0]),
            "states": doubles(target.base.states[:, 0]),
            "effects": {
                j: {
                    "p": effect.parameters.tolist(), "s": effect.states.tolist(),
                    "table": None if effect.table is None else doubles(effect.table),
                }
                for j, effect in effects
                if not effect.nothing
            },
            "modules": {name: self._module(target, name) for name in SOLVERS},
        }  # fmt: skip

    def _module(self, target: Target, solver: str) -> str:
        reader = target.family.reader
        simulation = replace(reader.simulation, solver=SOLVERS[solver])
        alone = Case(reader.problem, (reader.controller,), simulation)
        program = Target.of(alone, 0, simulation).family.members.program
        assert program.accumulators is not None
        made = module_of(program.program, program.shape, program.accumulators.resets, program.sample, program.watch)
        return base64.b64encode(made).decode()


def _drawn(number: Number, share: float, draw: np.random.Generator) -> int:
    """A place among a number's values, at most this share of them from its own."""
    own, most = int(np.searchsorted(number.values, number.value)), len(number.values) - 1
    return int(np.clip(own + round(share * most * draw.uniform(-1, 1)), 0, most))


def _agrees(target: Target, case: Case, found: tuple[Array, Array]) -> bool:
    made = target.read([case])
    return all((part == rows[:, 0]).all() for part, rows in zip(found, (made.parameters, made.states), strict=True))


def _switches(source: Source, case: Case, i: int) -> bool:
    """Whether switching the i-th controller's projection makes a case with another kernel."""
    try:
        switched = source.at({}, [i])
    except InputError:
        return False
    simulation: Simulation = case.simulation
    programs = [Target.of(one, i, simulation).family.members.program.program for one in (case, switched)]
    return programs[0] != programs[1]


def _outputs(case: Case, members: Members) -> dict[str, Any]:
    """Where in a module's rows what is drawn and what is told stands."""
    loop, shape, accumulators = members.loop, members.program.shape, members.program.accumulators
    assert isinstance(accumulators, Accumulators)
    marked, _ = unflatten(loop._initial, np.arange(loop.size), 0)
    rows = loop.theta_hat_rows
    output = loop.measured_outputs > 0
    gains, true = gains_at_rest(case.problem), true_values(case.problem, loop)
    panels = [
        {"state": state, "commands": [{"index": k, "gain": float(gains[state, k])} for k in commands]}
        for state, commands in commanded(case.problem)
    ]
    return {
        "shape": {
            "states": shape.states, "accumulators": shape.accumulators, "parameters": shape.parameters,
            "pieces": shape.in_pieces, "commands": loop.commands or 1,
        },
        "dt_row": shape.parameters - 1,
        "rhythm": members.rhythm.sample_every and float(loop.sample_time or 0.0),
        "operations": [list(part) for part in accumulators.layout],
        "theta_hat": [rows.start, rows.stop],
        "x": [int(i) for i in marked.x.reshape(-1)], "x_m": [int(i) for i in marked.x_m.reshape(-1)],
        "output": output, "panels": panels,
        "true": None if true is None else [float(v) for v in true],
    }  # fmt: skip


def _precedence(given: tuple[FieldPath, float]) -> tuple[int, bool]:
    path, first = given[0], str(given[0].keys[0])
    return PRECEDENCE.index(first if first in PRECEDENCE else ""), isinstance(path.keys[-1], int)


def _group_name(number: Number, case: Case) -> str:
    first, *rest = number.group
    if first == "controller":
        return case.controllers[int(rest[0])].name
    known = {"plant": "Plant", "reference_model": "Model", "reference": "Command", "uncertainty": "Known set"}
    return known.get(str(first), str(first).replace("_", " ").capitalize())
