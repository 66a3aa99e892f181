"""Checks a controller's equations before they are traced: evaluates them on numbers and on symbols, and compares the two.

A run evaluates the equations on symbols only once. Code that does not yield an expression for symbols (an ``if``, a number made
from a symbol) would silently become a constant of the run, or NaN. Each equation is therefore compared with its values on
numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from barbalat import vocabulary
from barbalat.loop.packing import column, flatten, map_arrays, symbols, unflatten
from barbalat.loop.user_errors import Subject, require_array, require_like, require_state, telling_user_errors
from barbalat.protocols import DiscretizedEquations, Dynamics, Equations, Sample, SampledEquations
from barbalat.roles import Role, declared_roles, leaves, names_of, state_parts
from barbalat.validate import Array, counted, show

POINTS_TRIED = 4
"""States at which the equations are evaluated: the initial state, and others drawn around it."""
AGREEMENT_WITHIN = 1e-8
"""Tolerance relative to the largest entry of an equation. Sums in a different order differ by far less, and different equations
by far more."""
CONTINUOUS, SAMPLED = ("initial", "control", "derivative", "limit"), ("initial", "control", "advance")


class Ports(NamedTuple):
    """The values that equations receive in addition to their state, as numbers of the right shapes."""

    y: Array  # (n,) the plant's state, or its output
    y_m: Array  # the model's
    r: Array  # the command, or (q,) commands
    u: Array  # the control: a number, or (m,)

    @classmethod
    def of(cls, plant: Dynamics, model: Dynamics, commands: int | None, inputs: int) -> Ports:
        """Return the values of a loop at t = 0 with commands and inputs at zero; for ``commands``, see ``ClosedLoop``."""
        y, y_m = (np.asarray(part.output(part.x0), dtype=float) for part in (plant, model))
        return cls(y, y_m, np.zeros(() if commands is None else commands), np.zeros(() if inputs == 1 else inputs))


class Arguments(NamedTuple):
    """All arguments of an equation; ``before`` and ``held`` are for sampled equations."""

    state: Any
    now: Ports
    before: Ports


def check_equations(equations: Equations | SampledEquations, ports: Ports, whose: Subject) -> None:
    """Raise InputError if the equations cannot be traced, or give different values on symbols and on numbers.

    ``whose`` is the controller, for the messages.
    """
    if isinstance(equations, DiscretizedEquations):
        check_equations(equations.continuous, ports, whose)
    _require_methods(equations, whose)
    whose = whose.part(f": {type(equations).__name__}")
    with telling_user_errors(whose.part(".initial")):
        initial = equations.initial()
    require_state(initial, whose.part(".initial"), declared_roles(equations))
    _require_roles(equations, initial, whose)
    numbers = TrialCall(whose, equations, Arguments(initial, ports, ports))
    for equation in numbers.equations:
        numbers.compare(equation, numbers.equations[equation])


def _require_roles(equations: Any, initial: Any, whose: Subject) -> None:
    """Raise InputError for roles of fields that the state lacks, and if the names and the estimates differ in number."""
    declared: Any = declared_roles(equations)
    whose = whose.part(".roles")
    if declared is None:
        return
    if not isinstance(declared, Mapping) or not all(isinstance(role, Role) for role in declared.values()):
        raise whose.error(
            f" must be a mapping from the names of fields to roles, as Role.estimates() or 'filter', got {show(declared)}"
        )
    paths = [path for path, _ in leaves(initial)]
    places = {path.rsplit(".", depth)[0] for path in paths for depth in range(path.count(".") + 1)}
    if unknown := [path for path in declared if path not in places and path.partition(".")[0] not in names_of(initial)]:
        raise whose.error(
            f" names {show(unknown[0])}, but {type(initial).__name__} does not have it; it has {', '.join(names_of(initial))}"
        )
    for part in state_parts(equations, initial):
        names: Any = part.role.names
        if names is not None and (
            not isinstance(names, tuple) or len(names) != part.size or not all(isinstance(name, str) for name in names)
        ):
            raise whose.error(
                f": the names of {part.path} must be a tuple of {counted(part.size, 'string')}, one for each estimate, "
                f"got {show(names)}"
            )


def check_varied(numbers: Any, varied: Any, ports: Ports, values: tuple[Any, Array]) -> None:
    """Check an ensemble's equations, in which a column of symbols replaces settings whose values are the numbers (p,)."""
    whose = Subject(f"an ensemble: {type(numbers).__name__}")
    trial = TrialCall(whose, numbers, Arguments(numbers.initial(), ports, ports), *values)
    others = TrialCall(whose, varied, trial.arguments).equations
    for equation in trial.equations:
        trial.compare(equation, others[equation])


def _require_methods(equations: Any, whose: Subject) -> None:
    """Raise InputError for an object without a method that a loop calls."""
    wanted = SAMPLED if isinstance(equations, SampledEquations) else CONTINUOUS
    missing = [name for name in wanted if name not in dir(equations)]
    if missing or isinstance(equations, type):
        kind = "a class" if isinstance(equations, type) else f"a {type(equations).__name__} without {', '.join(missing)}"
        raise whose.error(
            ": bind must return an object with the methods initial(), control(state, x, x_m, r), limit(state) and "
            f"derivative(state, x, x_m, r, u), got {kind}"
        )


Equation = Callable[[Arguments], Any]


@dataclass(frozen=True, eq=False)
class TrialCall:
    """An object's equations, each as a function of all arguments; ``settings`` are symbols among the object's numbers."""

    whose: Subject
    of: Any
    arguments: Arguments
    settings: Any = None
    numbers: Any = ()

    @cached_property
    def equations(self) -> dict[str, Equation]:
        of = self.of
        found: dict[str, Equation] = {"control": lambda a: of.control(a.state, a.now.y, a.now.y_m, a.now.r)}
        if isinstance(of, SampledEquations):
            return found | {"advance": lambda a: of.advance(a.state, Sample(*a.before[:3]), a.before.u, Sample(*a.now[:3]))}
        return found | {"derivative": lambda a: of.derivative(a.state, *a.now), "limit": lambda a: of.limit(a.state)}

    def compare(self, equation: str, symbolic: Equation) -> None:
        """Compare one equation's values on numbers and on symbols, at all points."""
        import casadi as ca

        what = self.whose.part(f".{equation}")
        expected = [self._evaluated(equation, self.equations[equation], arguments) for arguments in self._points]
        given, traced = self._symbols
        with telling_user_errors(what.on_symbols):
            found = symbolic(traced)
        self._require(equation, found, what.on_symbols)
        inputs, more = ([given], []) if self.settings is None else ([given, self.settings], [self.numbers])
        function = ca.Function("equation", inputs, [column(flatten((found,)))])
        if unknown := vocabulary.unknown(function):
            raise what.error(
                f" uses {', '.join(unknown)}, for which there is no machine code: write it with + - * /, powers and "
                "np.sqrt, exp, log, sin, cos, tan, tanh, arctan, abs, sign, minimum, maximum, clip, where, floor, ceil"
            )
        for arguments, numbers in zip(self._points, expected, strict=True):
            self._same(np.array(function(flatten(arguments), *more)).reshape(-1), numbers, what)
        never = np.flatnonzero(~np.isfinite(expected).any(axis=0))
        if len(never):
            raise what.error(f" gives {expected[0][never[0]]:.6g} on all numbers tried, in entry {never[0] + 1}")

    def _evaluated(self, equation: str, call: Equation, arguments: Arguments) -> Array:
        what = self.whose.part(f".{equation}").on_numbers
        with np.errstate(all="ignore"), telling_user_errors(what):
            found = call(map_arrays(np.copy, arguments))  # a copy, because the equation may change its arguments in place
        self._require(equation, found, what)
        return np.asarray(flatten((found,)), dtype=float)

    def _require(self, equation: str, found: Any, what: Subject) -> None:
        if equation == "control":
            require_array(found, self.arguments.now.u.shape, what, "u")
        else:
            require_like(found, self.arguments.state, what)

    @cached_property
    def _points(self) -> list[Arguments]:
        """The initial state with random measurements, followed by random states."""
        rng = np.random.default_rng(0)
        first = Arguments(self.arguments.state, *(_moved(ports, rng) for ports in self.arguments[1:]))
        return [first, *(_moved(self.arguments, rng) for _ in range(POINTS_TRIED - 1))]

    @cached_property
    def _symbols(self) -> tuple[Any, Arguments]:
        given, flat = symbols("given", len(flatten(self.arguments)))
        arguments, _ = unflatten(self.arguments, flat, 0)
        return given, arguments

    def _same(self, symbolic: Array, numbers: Array, what: Subject) -> None:
        lost = np.isnan(symbolic) & np.isfinite(numbers)
        if lost.any():
            raise what.error(
                " turns symbols into numbers, which are NaN in a run: use NumPy's functions instead of math's and of float(), "
                "and np.stack or np.concatenate instead of filling an array entry by entry"
            )
        size = float(np.abs(numbers[np.isfinite(numbers)]).max(initial=0.0))
        differs = np.flatnonzero(
            ~np.isclose(symbolic, numbers, rtol=AGREEMENT_WITHIN, atol=AGREEMENT_WITHIN * size, equal_nan=True)
        )
        if len(differs):
            i = differs[0]
            if not np.isfinite(numbers[i]):
                raise what.error(
                    f" gives {numbers[i]:.6g} "
                    "on finite numbers, as 0/0 does: it must not divide by a number that may be zero; add a positive number to "
                    "the denominator, or select a nonzero denominator with np.where"
                )
            raise what.error(
                f" gives {numbers[i]:.6g} on numbers and {symbolic[i]:.6g} on symbols"
                ": it may depend only on its arguments and constant settings; keep any memory in the state, and do not use "
                "random numbers"
            )


def _moved(part: Any, rng: np.random.Generator) -> Any:
    """Random numbers of the same shapes near the given ones: the distance is about their magnitude, and at least about 1."""
    return map_arrays(lambda value: value + (1 + np.abs(value)) * rng.uniform(-1, 1, value.shape), part)
