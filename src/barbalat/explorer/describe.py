"""Everything that a page knows of a case, as data: modules, the numbers that go into them, what their outputs are."""

from __future__ import annotations

import base64
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

from barbalat.cases.build import Case
from barbalat.explorer.commands import HORIZON_FACTORS, breaks_anywhere, grids_of, is_computed, points_of, smooth_module
from barbalat.explorer.condition import condition_of
from barbalat.explorer.encoded import doubles
from barbalat.explorer.outputs import delay_weights, numbers_handed, outputs
from barbalat.explorer.slider_labels import group, label
from barbalat.explorer.sliders import DELAY_PATH, GRID_KEYS, Slider, Sliders, Variant
from barbalat.explorer.source import Source
from barbalat.explorer.spectrum import WATCHING, judged, spectrum_of
from barbalat.lowering.wasm.loop import loop as module_of
from barbalat.lowering.wasm.normal import normal_module
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.probe import Target
from barbalat.solvers import SOLVERS
from barbalat.validate import InputError

MOST_STEPS = 10_000_000
"""Of a run in a page: some seconds."""


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
        return cls(source, case, tuple(i for i in range(len(case.controllers)) if _switches(source, case, i)))

    @cached_property
    def variants(self) -> list[Variant]:
        """Every controller, those that can be switched both ways."""
        found = [Variant(i, False, Target.of(self.case, i, self.case.simulation)) for i in range(len(self.case.controllers))]
        switched = self.source.at({}, self.toggles)
        return found + [Variant(i, True, Target.of(switched, i, switched.simulation)) for i in self.toggles]

    @cached_property
    def _search(self) -> Sliders:
        return Sliders(self.source, self.case, self.toggles, self.variants)

    @cached_property
    def sliders(self) -> list[Slider]:
        return self._search.found()

    def as_data(self) -> dict[str, Any]:
        """For the page's JSON."""
        problem, simulation = self.case.problem, self.case.simulation
        module, values = smooth_module(problem.signals)
        return {
            "case": problem.name,
            "simulation": {
                "t_end": simulation.t_end, "dt": simulation.dt, "solver": simulation.solver.name,
                "record_points": simulation.record_points, "most_steps": MOST_STEPS,
            },
            "solvers": {
                name: {"nodes": list(one.nodes), "polynomial": one.stability_polynomial.tolist()} for name, one in SOLVERS.items()
            },
            "signals": {
                "module": base64.b64encode(module).decode(), "parameters": doubles(values),
                "smooth": [is_computed(signal) for signal in problem.signals],
                "points": [points_of(signal, max(HORIZON_FACTORS) * simulation.t_end) for signal in problem.signals],
                "grids": self._grids() if breaks_anywhere(problem.signals) else None,
            },
            "noise": self._noise(),
            "delay": self._delay() if problem.delay > 0 else None,
            "numbers": [
                {
                    "path": str(one.number.path), "label": label(one.number.path),
                    "group": _group_name(one.number.path, self.case),
                    "value": one.number.value, "values": doubles(one.number.values), "whole": one.number.whole,
                    "log": one.number.logarithmic, "without": list(one.number.without),
                    "signals": one.signals.places, "scales": one.signals.scales,
                    "grids": None if one.signals.grids is None else [grid.as_data() for grid in one.signals.grids],
                    "copied": one.copied,
                    "excludes": [k for k, other in enumerate(self.sliders) if other is not one and one.excludes(other)],
                }
                for one in self.sliders
            ],
            "controllers": [self._controller(i) for i in range(len(self.case.controllers))],
            "case_file": self.source.case_file(self.slots(), self.toggles),
            "own_file": self.source.own_file,
            "toggles": list(self.toggles), "watching": WATCHING,
        }  # fmt: skip

    def slots(self) -> list[FieldPath]:
        """Places in a copied case file that take a number of the page: the sliders', horizon and step, the delay."""
        own = [FieldPath(("simulation", key)) for key in GRID_KEYS]
        return [
            *(one.number.path for one in self.sliders),
            *own,
            *([DELAY_PATH] if self.case.problem.delay > 0 and self._delay()["slider"] else []),
        ]

    def _noise(self) -> dict[str, Any] | None:
        """The seed as digits: numbers of a page have 53 bits."""
        noise, channels = self.case.problem.noise, self.case.problem.dynamics.outputs
        if noise is None:
            return None
        module = base64.b64encode(normal_module(channels)).decode()
        return {"module": module, "seed": str(noise.seed), "channels": channels, "sample_time": noise.sample_time}

    def _delay(self) -> dict[str, Any]:
        """It has a slider where the case has one number that is the delay."""
        own = self.case.problem.delay
        tried = own + self.case.simulation.dt
        try:
            moves = self.source.at({DELAY_PATH: tried}).problem.delay == tried
        except InputError:
            moves = False
        return {"value": own, "slider": moves, "weights": delay_weights()}

    def _grids(self) -> list[dict[str, Any]]:
        signals, delayed = self.case.problem.signals, self.case.problem.delay > 0
        return [grid.as_data() for grid in grids_of(signals, self.case.simulation, whole=delayed, most_steps=MOST_STEPS)]

    def _controller(self, i: int) -> dict[str, Any]:
        variants = {}
        for k, variant in enumerate(self.variants):
            if variant.index == i:
                asked = self.source.projected(i) != variant.switched
                variants["on" if asked else "off"] = self._variant(k, variant.target)
        target = self.variants[i].target
        return {
            "name": self.case.controllers[i].name, "projection": "on" if self.source.projected(i) else "off",
            "variants": variants, "condition": condition_of(self.case, i, self.sliders, partial(self._search.at, False)),
            **outputs(self.case, target.family.members),
        }  # fmt: skip

    def _variant(self, k: int, target: Target) -> dict[str, Any]:
        effects = [(j, slider.effects[k]) for j, slider in enumerate(self.sliders)]
        return {
            "parameters": doubles(target.base.parameters[: numbers_handed(target.family.members), 0]),
            "states": doubles(target.base.states[:, 0]),
            "effects": {
                j: {
                    "p": effect.parameters.tolist(), "s": effect.states.tolist(),
                    "table": None if effect.table is None else doubles(effect.table),
                }
                for j, effect in effects
                if not effect.nothing
            },
            "modules": {name: _module(target, name) for name in SOLVERS}, "spectrum": spectrum_of(target),
        }  # fmt: skip


def _module(target: Target, solver: str) -> str:
    reader = target.family.reader
    simulation = replace(reader.simulation, solver=SOLVERS[solver])
    alone = Case(reader.problem, (reader.controller,), simulation)
    made = Target.of(alone, 0, simulation)
    program = made.family.reader.members(WATCHING["windows"] if judged(made) else 0).program
    assert program.accumulators is not None
    module = module_of(program.program, program.shape, program.accumulators.resets, program.sample, program.watch)
    return base64.b64encode(module).decode()


def _switches(source: Source, case: Case, i: int) -> bool:
    """Whether switching the i-th controller's projection makes a case with another kernel."""
    try:
        switched = source.at({}, [i])
    except InputError:
        return False
    programs = [Target.of(one, i, case.simulation).family.members.program.program for one in (case, switched)]
    return programs[0] != programs[1]


def _group_name(path: FieldPath, case: Case) -> str:
    first, *rest = group(path)
    if first == "controller":
        return case.controllers[int(rest[0])].name
    known = {"plant": "Plant", "reference_model": "Model", "reference": "Command", "uncertainty": "Known set"}
    return known.get(str(first), str(first).replace("_", " ").capitalize())
