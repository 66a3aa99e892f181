"""The data of a page on a case: modules, their numbers, and the meaning of their outputs."""

from __future__ import annotations

import base64
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from barbalat.cases.build import Case
from barbalat.explorer.commands import HORIZON_FACTORS, breaks_anywhere, grids_of, is_computed, points_of, smooth_module
from barbalat.explorer.condition import condition_of
from barbalat.explorer.encoded import doubles
from barbalat.explorer.faults import fault_of, fixed
from barbalat.explorer.faults import rules as rules_of_faults
from barbalat.explorer.judging import kept, rules
from barbalat.explorer.sliders import DELAY_PATH, GRID_KEYS, Slider, Sliders, Variant
from barbalat.explorer.source import Source
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import column, symbols, unflatten
from barbalat.loop.true_values import estimate_names, true_values, truth_of
from barbalat.lowering.operations import read
from barbalat.lowering.optimize import optimize
from barbalat.lowering.shape import WATCH_EVERY, LoopShape
from barbalat.lowering.wasm.loop import loop as module_of
from barbalat.lowering.wasm.normal import normal_module
from barbalat.open_numbers.path import FieldPath, Key
from barbalat.open_numbers.probe import Target
from barbalat.pictures.symbols import estimated
from barbalat.problem.command_gain import commanded, gains_at_rest
from barbalat.problem.labels import UNLABELLED
from barbalat.protocols import DiscretizedEquations
from barbalat.run.engine.judging import watched_in_sweeps
from barbalat.run.engine.stability_label import MOST_LOOKS, MOST_WINDOWS, WINDOW_PIECES
from barbalat.run.kernel import delay
from barbalat.run.kernel.members import Members, Reader
from barbalat.run.kernel.metrics import Accumulators
from barbalat.run.kernel.template import Template
from barbalat.run.results.estimates import MOST_REPORTED
from barbalat.run.results.outcome import about_u
from barbalat.solvers import SOLVERS, Tableau
from barbalat.validate import InputError

MOST_STEPS = 10_000_000
"""Largest number of steps of a run in a page. Such a run takes a few seconds."""


@dataclass(frozen=True, eq=False)
class Described:
    """A case in the form that its page needs.

    toggles  the controllers whose projection can be switched
    """

    source: Source
    case: Case
    toggles: tuple[int, ...]

    @classmethod
    def of(cls, source: Source) -> Described:
        case = source.at({})
        case.simulation.require_steps("a page that simulates")
        return cls(source, case, tuple(i for i in range(len(case.controllers)) if _switches(source, case, i)))

    @cached_property
    def variants(self) -> list[Variant]:
        """All controllers, with both versions of those whose projection can be switched."""
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
        """Return the data for the page's JSON."""
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
                "faults": [fault_of(signal) for signal in problem.signals], "drawing": rules_of_faults(problem.signals),
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
                    "signals": one.signals.places, "scales": one.signals.scales, "drawn": one.signals.drawn,
                    "grids": None if one.signals.grids is None else [grid.as_data() for grid in one.signals.grids],
                    "copied": one.copied,
                    "excludes": [k for k, other in enumerate(self.sliders) if other is not one and one.excludes(other)],
                }
                for one in self.sliders
            ],
            "controllers": [self._controller(i) for i in range(len(self.case.controllers))],
            "case_file": self.source.case_file(self.slots(), self.toggles),
            "own_file": self.source.own_file,
            "toggles": list(self.toggles), "watching": WATCHING, "judge": rules(self.case), "about_u": about_u(problem),
            "fixed": fixed(problem),
        }  # fmt: skip

    def slots(self) -> list[FieldPath]:
        """Return the numbers that the page inserts into a copied case file: those of the sliders, horizon and step, and the
        delay."""
        own = [FieldPath(("simulation", key)) for key in GRID_KEYS]
        return [
            *(one.number.path for one in self.sliders),
            *own,
            *([DELAY_PATH] if self.case.problem.delay > 0 and self._delay()["slider"] else []),
        ]

    def _noise(self) -> dict[str, Any] | None:
        """Return the noise settings, with the seed as digits, because numbers in a page have only 53 bits."""
        noise, channels = self.case.problem.noise, self.case.problem.measured
        if noise is None:
            return None
        module = base64.b64encode(normal_module(channels)).decode()
        return {"module": module, "seed": str(noise.seed), "channels": channels, "sample_time": noise.sample_time}

    def _delay(self) -> dict[str, Any]:
        """Return the delay settings. The delay has a slider if it is a number of the case."""
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
            **outputs(self.case, page_members(self.case, target, self.case.simulation.solver)),
        }  # fmt: skip

    def _variant(self, k: int, target: Target) -> dict[str, Any]:
        effects = [(j, slider.effects[k]) for j, slider in enumerate(self.sliders)]
        return {
            "parameters": doubles(target.base.parameters[: numbers_handed(target), 0]),
            "states": doubles(target.base.states[:, 0]),
            "effects": {
                j: {
                    "p": effect.parameters.tolist(), "s": effect.states.tolist(),
                    "table": None if effect.table is None else doubles(effect.table),
                }
                for j, effect in effects
                if not effect.nothing
            },
            "modules": {name: _module(page_members(self.case, target, one)) for name, one in SOLVERS.items()},
            "spectrum": spectrum_of(target),
        }  # fmt: skip


def page_members(case: Case, target: Target, solver: Tableau) -> Members:
    """Return the controller with the kernel of its module for this solver. The kernel records what the judge and the page
    need."""
    reader = target.family.reader
    simulation, watched = replace(reader.simulation, solver=solver), watched_in_sweeps(case.judge)
    again = Reader.of((reader.problem, reader.controller), simulation, adjustable=False, watched=watched)
    return again.members(WATCHING["windows"] if judged(target) else 0)


def _module(members: Members) -> str:
    program = members.program
    assert program.accumulators is not None
    module = module_of(program.program, program.shape, program.accumulators.resets, program.sample, program.watch)
    return base64.b64encode(module).decode()


def _switches(source: Source, case: Case, i: int) -> bool:
    """Whether switching the i-th controller's projection gives a valid case with a different kernel."""
    try:
        switched = source.at({}, [i])
    except InputError:
        return False
    targets = [Target.of(one, i, case.simulation) for one in (case, switched)]
    programs = [page_members(case, target, case.simulation.solver).program.program for target in targets]
    return programs[0] != programs[1]


def _group_name(path: FieldPath, case: Case) -> str:
    first, *rest = group(path)
    if first == "controller":
        return case.controllers[int(rest[0])].name
    if first == "faults":
        return f"Fault {int(rest[0]) + 1}: {case.problem.faults[int(rest[0])].kind}"
    known = {"plant": "Plant", "reference_model": "Model", "reference": "Command", "uncertainty": "Known set"}
    return known.get(str(first), str(first).replace("_", " ").capitalize())


SYMBOLS = {
    "gamma": ("Γ", ""), "kappa": ("κ", "s"), "tau": ("τ", "s"), "theta": ("θ", ""), "x0": ("x(0)", ""), "k_0": ("k₀", ""),
    "amplitude": ("amplitude", ""), "frequency": ("frequency", "rad/s"), "phase": ("phase", "rad"), "t_end": ("horizon", "s"),
    "dt": ("step h", "s"), "c_0": ("c₀", ""), "covariance0": ("P(0)", ""), "alpha_0": ("α₀", ""), "delta_0": ("δ₀", "1/s"),
    "theta_hat0": ("θ̂(0)", ""), "sigma": ("σ", ""), "A_m": ("A_m", ""), "b": ("b", ""), "delay": ("delay", "s"),
    "gain": ("input gain", ""), "start": ("start", "s"), "sigma_bound": ("σ bound", ""), "lower": ("least", ""),
    "upper": ("greatest", ""), "input_gain": ("input gain", ""), "g_0": ("dead zone g₀", ""), "c_0_min": ("least c₀", ""),
    "frequencies": ("frequency", "rad/s"), "amplitudes": ("amplitude", ""), "rate_limit": ("rate limit", "1/s"),
    "lag": ("sensor lag", "s"), "std": ("noise, standard deviation", ""), "share": ("fraction of the time", ""),
    "burst": ("length of a burst", "s"), "times": ("from, to", "s"), "time": ("at most", "s"),
    "jitter": ("tolerated jitter, as a fraction of the sample "
    "time", ""), "longest_outage": ("longest outage", "s"), "fade": ("fade", "s"),
    "quantization": ("resolution", ""),
}  # fmt: skip
"""Symbol and unit of numbers for which the key does not determine them."""


def label(path: FieldPath) -> str:
    """Return the label of a number: its symbol, indices numbered from 1, and unit."""
    keys = [key for key in path.keys if isinstance(key, str)]
    symbol, unit = SYMBOLS.get(keys[-1], (keys[-1].replace("_", " "), ""))
    if keys[0] == "shell" and len(keys) > 2:  # a number of one channel
        symbol, unit = f"{keys[1]} of {keys[2]}", "s" if keys[1] == "stuck" else ""
    if keys[-1] in ("num", "den"):
        symbol = f"{keys[-2].replace('_', ' ')} {keys[-1]}"
    places = ",".join(str(int(index) + 1) for index in path.keys[len(path.vector) :])
    return symbol + (f" [{places}]" if places else "") + (f", {unit}" if unit else "")


def group(path: FieldPath) -> tuple[Key, ...]:
    """Return the table that contains a number. The table of a controller is ("controller", i)."""
    first = path.keys[0]
    return path.keys[:2] if first in ("controller", "reference", "faults") and isinstance(path.keys[1], int) else (first,)


def outputs(case: Case, members: Members) -> dict[str, Any]:
    """Return the data on one controller's outputs: sizes, rows of states and accumulators, and panels. ``members`` are the
    members of its module."""
    loop, shape, accumulators = members.loop, members.program.shape, members.program.accumulators
    assert isinstance(accumulators, Accumulators)
    marked, _ = unflatten(loop._initial, np.arange(loop.size), 0)
    rows = loop.theta_hat_rows
    gains, true = gains_at_rest(case.problem), true_values(case.problem, loop)
    names = case.problem.labels or UNLABELLED
    panels = [
        {"state": state, "name": names.name(state), "commands": [{"index": k, "gain": float(gains[state, k])} for k in commands]}
        for state, commands in commanded(case.problem)
    ]
    return {
        "shape": {
            "states": shape.states, "accumulators": shape.accumulators, "pieces": shape.in_pieces,
            "commands": loop.commands or 1, "delayed": shape.delayed,
        },
        "rhythm": members.rhythm.sample_every and float(loop.sample_time or 0.0),
        "jitters": loop.around is not None and loop.around.jitters,
        "operations": [list(part) for part in accumulators.layout],
        "theta_hat": [rows.start, rows.stop],
        "x": [int(i) for i in marked.x.reshape(-1)], "x_m": [int(i) for i in marked.x_m.reshape(-1)],
        "output": loop.measured_outputs > 0, "panels": panels,
        "model": {"rows": [int(i) for i in marked.x_m.reshape(-1)]}, "judge": kept(case, loop),
        "true": None if true is None else [float(v) for v in true],
        "estimates": [estimated(name) for name in estimate_names(case.problem, loop)],
        "reported": {part.name: [*range(part.rows.start, part.rows.stop)] for part in loop.other_estimates},
        "beside": _further_entries(case, loop),
        "past": None if members.history is None else members.history[:, 0].tolist(),
    }  # fmt: skip


def _further_entries(case: Case, loop: ClosedLoop) -> list[dict[str, Any]]:
    """Return the entries that are drawn in addition to theta_hat, with their true values."""
    found = []
    for part in loop.other_estimates:
        if part.size <= MOST_REPORTED:
            true = truth_of(case.problem, part)
            values = [None] * part.size if true is None else true.tolist()
            rows = range(part.rows.start, part.rows.stop)
            names = map(estimated, part.names)
            found += [{"label": name, "row": row, "true": one} for name, row, one in zip(names, rows, values, strict=True)]
    return found


def numbers_handed(target: Target) -> int:
    """Return the number of module parameters up to the step. The weights of the delay, which depend on the solver, follow the
    step."""
    weights = target.family.reader.weights
    return len(target.base.parameters) - (0 if weights is None else int(weights.first.size))


def delay_weights() -> dict[str, dict[str, str]]:
    """Return ``delay.weights`` by solver: the weights for whole steps, and a module that computes them for a fraction."""
    return {
        name: {
            "whole": doubles(delay.weights(1.0, 1.0, tableau).reshape(-1)),
            "module": base64.b64encode(_weights_module(tableau)).decode(),
        }
        for name, tableau in SOLVERS.items()
    }


def _weights_module(tableau: Tableau) -> bytes:
    """Return a module whose blocks compute the weights for the fraction in a row."""
    import casadi as ca

    fraction, nothing = ca.SX.sym("fraction"), ca.SX(0, 1)
    weights = delay.traced_weights(tableau)(fraction)
    traced = ca.Function("step", [nothing, nothing, nothing, fraction], [nothing, weights, nothing], {"cse": True})
    rows = weights.numel()
    return module_of(optimize(read(traced), fused=False), LoopShape(0, rows, 0, 1), (0.0,) * rows)


# The page's kernel monitors ``run.kernel.step.coupling_function``. ``templates/stability.js`` examines the windows, and the steps
# of a window with an exit, by the rules of ``run.engine.stability_label``.

MOST_STATES = 40
"""Largest number of states of a loop whose spectrum is computed after every run. Computing it for a few dozen states takes less
time than drawing."""


WATCHING = {"windows": MOST_WINDOWS, "looks": MOST_LOOKS, "pieces": WINDOW_PIECES, "every": WATCH_EVERY}
"""How a run is divided into windows and how these are evaluated; see ``run.engine.stability_label``."""


def judged(target: Target) -> bool:
    """Whether a page judges the step.

    Large loops, and sampled laws that take explicit steps, are judged only by ``barbalat run``.
    """
    reader = target.family.reader
    equations = reader.loop.equations
    return reader.loop.size <= MOST_STATES and not (isinstance(equations, DiscretizedEquations) and equations.explicit)


def spectrum_of(target: Target) -> dict[str, Any] | None:
    """Return the module of the spectrum, or None if the page does not judge the step. A row of the module is a state with signals
    and noise, and the module's parameters are those of the run."""
    import casadi as ca

    if not judged(target):
        return None
    reader = target.family.reader
    template = Template.of(reader.columns, opened=True).adjustable(reader.simulation.dt, None)
    loop = template.loop.following_within(template.dt)
    state_column, state = symbols("state", loop.size)
    given_column, given = symbols("given", loop.signals.timed + loop.signals.noise)
    signals = np.concatenate([given, np.zeros(loop.signals.delayed)])
    jacobian = ca.jacobian(column(loop.derivative(state, signals)), state_column)
    rows, columns = jacobian.sparsity().get_triplet()
    nothing = ca.SX(0, 1)
    row = ca.vertcat(state_column, given_column)
    inputs = [nothing, nothing, template.column, row, nothing, nothing]
    found = ca.vertcat(nothing, *(jacobian[int(i), int(j)] for i, j in zip(rows, columns, strict=True)))
    traced = ca.Function("jacobian", inputs, [nothing, found, nothing], {"cse": True})
    shape = LoopShape(0, len(rows), len(template.values), loop.size + loop.signals.timed + loop.signals.noise)
    module = module_of(read(traced), shape, (0.0,) * len(rows))
    return {"module": base64.b64encode(module).decode(), "rows": list(rows), "columns": list(columns)}
