"""The truth: the plant that is simulated, if it differs from the one for which controllers are designed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.problem.actuation import PlantInput
from barbalat.problem.formulas import BEND_OF_ABS, Formula
from barbalat.problem.measurement import Sensor
from barbalat.problem.parameters import evaluated, parsed
from barbalat.problem.physical import input_matrix, inputs_at, names_in, sensor_at
from barbalat.problem.plant import Plant
from barbalat.problem.tracking import Disturbance
from barbalat.protocols import Signal, Value
from barbalat.settings import Settings, one_line
from barbalat.validate import Array, InputError, Matrix, freeze


@dataclass(frozen=True, eq=False, kw_only=True)
class Friction(Settings):
    """Smooth Coulomb friction: -coulomb tanh(x/width) in the rate of a state, such as an angular rate.

    state    the state, by its name, in whose rate the friction acts
    coulomb  >= 0, the deceleration at large rates [unit of the state per s]
    width    > 0, width of the transition around zero [unit of the state]: at that rate 76 % of the friction acts
    """

    state: str
    coulomb: float
    width: float

    def __post_init__(self) -> None:
        freeze(
            self,
            state=validate.line("truth.friction.state", self.state),
            coulomb=validate.not_negative("truth.friction.coulomb", self.coulomb),
            width=validate.positive("truth.friction.width", self.width),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Truth(Settings):
    """The simulated plant. Anything not given is as in the plant for which controllers are designed.

    parameters   physical parameters whose values differ from the nominal ones, by name
    A            (N, N), for more states than the plant has or for different dynamics. Its entries, and those of b and x0, may be
                 formulas of the parameters
    b            (N,), or (N, m)
    C            (p, N) the measurement of the truth's states, in place of the observer's C; for example, for a wrong encoder
                 scale or a sensor at a different place. Only with an observer
    x0           (N,) initial state
    input        the path before the input, in the form of ``plant.input``, which it replaces as a whole; with several inputs, one
                 path for all inputs, or a list. With formulas, give keywords of PlantInput
    disturbance  matched: it enters with u
    unmatched    other disturbances: direction (N,) times the signal is added to x'; they replace the plant's
    sensor       the path from the plant's state to the measurement, in place of the case's sensor. With formulas, give keywords
                 of Sensor
    states       names of the truth's states, or of the first of them; states with the names of the plant's states are the plant's
                 states. Alternatively a matrix (n, N) that computes the plant's states from them. Needed if N differs from the
                 plant's n
    friction     smooth Coulomb friction in the rates of states, a table for each: state; coulomb, a deceleration, which is the
                 friction torque divided by the inertia; width, the rate at which 76 % of it acts. All are numbers; a friction
                 that depends on parameters is a term, such as "-T_c/J*tanh(x2/0.01)"
    terms        by a state's name, a formula that is added to its rate, for example a saturating spring or a dead zone. It may
                 contain x1, x2, ... of the truth, u (u1, u2, ... with several inputs) as it reaches the plant, and parameters
    """

    parameters: Mapping[str, float] = field(default_factory=dict)
    A: Any = None
    b: Any = None
    C: Any = None
    x0: Any = None
    input: Any = None
    disturbance: Signal | None = None
    unmatched: tuple[Disturbance, ...] | None = None
    sensor: Sensor | Mapping[str, Any] | None = None
    states: tuple[str, ...] | Matrix | None = None
    friction: tuple[Friction, ...] = ()
    terms: Mapping[str, str] = field(default_factory=dict)
    __repr__ = one_line

    def __post_init__(self) -> None:
        for friction in self.friction:
            validate.instance("truth.friction", friction, Friction)
        for disturbance in self.unmatched or ():
            validate.instance("truth.unmatched", disturbance, Disturbance)
        if self.sensor is not None:
            validate.instance("truth.sensor", self.sensor, (Sensor, Mapping))
        for name in ("parameters", "terms"):
            if not isinstance(getattr(self, name), Mapping):
                raise InputError.of(f"truth.{name}", f"must give a value for each name, got {validate.show(getattr(self, name))}")
        freeze(self, friction=tuple(self.friction), unmatched=None if self.unmatched is None else tuple(self.unmatched))


@dataclass(frozen=True, eq=False)
class TruePlant:
    """The system that a loop integrates instead of the plant: x' = A x + B v + terms, of which a controller receives S x.

    S          (n, N); None if the states are the plant's own
    friction   (row, coulomb, width) for each friction
    terms      (row, formula) for each term
    values     values of the parameters in the formulas
    C          (p, N) the measurement for an observer; None if it is the observer's own measurement of S x
    nonlinear  the plant, if its regressor is not the state. Its uncertainty b theta'phi(x) then acts in addition to B and to A,
               which is the plant's A_m
    """

    A: Array
    b: Array
    x0: Array
    S: Array | None
    friction: tuple[tuple[int, float, float], ...]
    terms: tuple[tuple[int, str], ...]
    values: Mapping[str, float]
    names: tuple[str, ...]
    nonlinear: Plant | None = None
    C: Array | None = None

    @property
    def outputs(self) -> int:
        """The number of measured quantities, which are the plant's states."""
        return len(self.x0) if self.S is None else len(self.S)

    @property
    def bend(self) -> str | None:
        """The place where a term has a corner."""
        return BEND_OF_ABS if any(self._formula(text).bends for _, text in self.terms) else None

    def derivative(self, x: Value, v: Value) -> Value:
        """Return x' for the input v, which is the part of u that reaches the plant, plus d."""
        rate = self.A @ x + np.dot(self.b, v)
        if self.nonlinear is not None:
            plant = self.nonlinear
            rate = rate + plant.derivative(x, 0 * v) - plant.A_m @ x
        if not self.friction and not self.terms:
            return rate
        given: dict[str, Value] = {f"x{i + 1}": x[i] for i in range(len(self.x0))} | dict(self.values)
        given |= {"u": v} if self.b.ndim == 1 else {f"u{k + 1}": v[k] for k in range(self.b.shape[1])}
        added = [0 * x[0]] * len(self.x0)
        for row, coulomb, width in self.friction:
            added[row] = added[row] - coulomb * np.tanh(x[row] / width)
        for row, text in self.terms:
            added[row] = added[row] + self._formula(text).evaluate(given)
        return rate + np.concatenate([one.reshape(1) for one in added])

    def output(self, x: Value) -> Value:
        """Return the measurement, which is the plant's states."""
        return x if self.S is None else self.S @ x

    def _formula(self, text: str) -> Formula:
        return parsed("truth.terms", text, self.known_names)

    @property
    def known_names(self) -> tuple[str, ...]:
        """The names that a term may use."""
        m = 1 if self.b.ndim == 1 else self.b.shape[1]
        inputs = ("u",) if self.b.ndim == 1 else tuple(f"u{k + 1}" for k in range(m))
        return (*(f"x{i + 1}" for i in range(len(self.x0))), *inputs, *self.values)

    @property
    def is_linear(self) -> bool:
        """Whether only A and b act, without terms or friction."""
        return not self.friction and not self.terms and self.nonlinear is None


def own_states(plant: Plant) -> TruePlant:
    """Return the plant on which a baseline acts, without the baseline's states."""
    A, b = plant.open_loop
    names = tuple(f"x_{i + 1}" for i in range(plant.states))
    return TruePlant(A=A, b=b, x0=np.asarray(plant.x0)[: plant.states], S=None, friction=(), terms=(), values={}, names=names)


def true_plant(truth: Truth, plant: Plant, labels: Sequence[str]) -> TruePlant:
    """Return the dynamics of a truth for a plant whose states are called ``labels``. Raises InputError if the two do not fit."""
    values = _values(truth, plant)
    if plant.physical is None and truth.parameters:
        raise InputError.of(
            "truth.parameters", f"requires the table [parameters], which the case lacks; got {', '.join(truth.parameters)}"
        )
    A, b = _matrices(truth, plant, values)
    N, n = len(A), plant.states
    if n != N and truth.states is None:
        raise InputError.of(
            "truth.states",
            f"is missing: truth.A has {validate.counted(N, 'state')} and the plant has {n}; name the truth's states, or "
            f"give a matrix {n} x {N}",
        )
    names, S = _mapped(truth.states, labels, N)
    x0 = _initial(truth, plant, values, S)
    found = TruePlant(
        A=A,
        b=b,
        x0=x0,
        S=S,
        friction=tuple((_row("truth.friction.state", one.state, names), one.coulomb, one.width) for one in truth.friction),
        terms=tuple((_row(f"truth.terms.{state}", state, names), text) for state, text in truth.terms.items()),
        values=values,
        names=names,
        nonlinear=None if plant.is_linear else plant,
        C=None if truth.C is None else validate.array("truth.C", evaluated("truth.C", _plain(truth.C), values), (None, N)),
    )
    own = found.known_names[: len(found.known_names) - len(values)]
    for state, text in truth.terms.items():
        if both := sorted(parsed(f"truth.terms.{state}", text, found.known_names).names & set(own) & set(values)):
            raise InputError.of(
                f"truth.terms.{state}",
                f"uses {both[0]}, which is a parameter and also the name of a state or an input in terms: rename the parameter",
            )
    return found


def _matrices(truth: Truth, plant: Plant, values: Mapping[str, float]) -> tuple[Array, Array]:
    """Return A (N, N) and b, (N,) or (N, m)."""
    if not plant.is_linear:
        if truth.A is not None or truth.states is not None:
            raise InputError.of("truth.A", "and truth.states need a plant whose regressor is the state")
        A = plant.A_m
    elif truth.A is not None:
        A = validate.square_matrix("truth.A", evaluated("truth.A", _plain(truth.A), values))
    elif plant.physical is not None:
        A = plant.physical.matrices(values)[0]
    else:
        A = plant.open_loop[0]
    if truth.b is not None:
        b = input_matrix("truth.b", evaluated("truth.b", _plain(truth.b), values), len(A))
    elif len(A) != plant.states:
        raise InputError.of(
            "truth.b",
            f"is missing: truth.A has {validate.counted(len(A), 'state')} and plant.b has "
            f"{validate.counted(plant.states, 'row')}",
        )
    else:
        b = plant.b[: plant.states] if plant.physical is None else plant.physical.matrices(values)[1]
    if (1 if b.ndim == 1 else b.shape[1]) != plant.inputs:
        raise InputError.of(
            "truth.b", f"must have {validate.counted(plant.inputs, 'input')}, like plant.b, got {validate.show(b)}"
        )
    return A, b


def _plain(given: Any) -> Any:
    return given.tolist() if isinstance(given, np.ndarray) else given


def _mapped(states: Any, labels: Sequence[str], N: int) -> tuple[tuple[str, ...], Array | None]:
    """Return the names of the truth's states, and the matrix that gives the plant's states; None if they are the same."""
    n = len(labels)
    if states is None:
        return tuple(labels), None
    if not all(isinstance(one, str) for one in states):
        S = validate.array("truth.states", states, (n, N))
        return tuple(labels) if n == N and (np.eye(n) == S).all() else tuple(f"x_{i + 1}" for i in range(N)), S
    if len(states) > N:
        raise InputError.of("truth.states", f"must name at most the truth's {validate.counted(N, 'state')}, got {len(states)}")
    names = (*states, *(f"x_{i + 1}" for i in range(len(states), N)))
    for label in labels:
        if names.count(label) != 1:
            raise InputError.of(
                "truth.states",
                f"must name the plant's states {', '.join(labels)} once each, got {', '.join(states)}",
            )
    S = np.zeros((n, N))
    S[np.arange(n), [names.index(label) for label in labels]] = 1.0
    return names, None if n == N and (np.eye(n) == S).all() else S


def _initial(truth: Truth, plant: Plant, values: Mapping[str, float], S: Array | None) -> Array:
    """Return x(0) (N,), as given, or the smallest one for which the plant's states equal x0."""
    N = plant.states if S is None else S.shape[1]
    if truth.x0 is not None:
        return validate.vector("truth.x0", evaluated("truth.x0", _plain(truth.x0), values), N)
    own = None if plant.physical is None else plant.physical.initial(values)
    x0 = np.asarray(plant.x0)[: plant.states] if own is None else validate.vector("plant.x0", own, plant.states)
    return x0 if S is None else np.asarray(np.linalg.pinv(S) @ np.asarray(x0, dtype=float))


def _row(field: str, state: str, names: tuple[str, ...]) -> int:
    if state not in names:
        raise InputError.of(
            field,
            f"does not name a state, got {validate.show(state)}; the states are {', '.join(names)}{validate.hint(state, names)}",
        )
    return names.index(state)


def true_inputs(truth: Truth, plant: Plant) -> tuple[PlantInput, ...]:
    """Return the path before each input of the simulated plant."""
    from barbalat.problem.plant import inputs_of

    given, values = truth.input, _values(truth, plant)
    if given is None and plant.physical is not None:
        given = plant.physical.inputs(values)
    elif any(isinstance(one, Mapping) for one in (given if isinstance(given, (list, tuple)) else (given,))):
        given = inputs_at("truth.input", given, values)
    if given is None:
        return plant.paths
    found = inputs_of("truth.input", given, plant.inputs)
    return found if isinstance(found, tuple) else (found,)


def true_sensor(truth: Truth, plant: Plant, sensor: Sensor | None) -> Sensor | None:
    """Return the sensor of the simulated plant."""
    if isinstance(truth.sensor, Sensor):
        return truth.sensor
    if truth.sensor is not None:
        return sensor_at("truth.sensor", truth.sensor, _values(truth, plant))
    if plant.physical is None or plant.physical.sensor is None:
        return sensor
    return plant.physical.sensing(_values(truth, plant))


def _values(truth: Truth, plant: Plant) -> Mapping[str, float]:
    """Return the values of the parameters in the simulated plant, keyed by name."""
    return {} if plant.physical is None else plant.physical.with_values(truth.parameters)


WITH_FORMULAS = ("A", "b", "x0", "input", "sensor")
"""What the simulated plant takes from the design plant, including formulas, unless [truth] defines it."""


def names_simulated(plant: Mapping[str, Any], truth: Mapping[str, Any]) -> set[str]:
    """Return the names in the formulas of the simulated plant: the truth's formulas and, where the truth has none, the plant's.

    plant, truth  the keys of [plant] with ``sensor``, and of [truth], or the fields of a PhysicalPlant and of a Truth
    """
    taken = [plant.get(key) for key in WITH_FORMULAS if truth.get(key) is None]
    return names_in([taken, *(truth.get(key) for key in (*WITH_FORMULAS, "C", "terms"))])


def true_unmatched(truth: Truth, simulated: TruePlant, of_plant: tuple[Disturbance, ...]) -> tuple[Disturbance, ...]:
    """Return the disturbances that do not act at the input, with directions in the truth's states."""
    N, S = len(simulated.x0), simulated.S
    if truth.unmatched is not None:
        for one in truth.unmatched:
            validate.vector("truth.unmatched.direction", one.direction, N)
        return truth.unmatched
    if S is None or not of_plant:
        return of_plant
    selects = ((S == 0) | (S == 1)).all() and (S.sum(axis=1) == 1).all()
    if not selects:
        raise InputError.of(
            "truth.unmatched",
            "is missing: if states is a matrix, the directions of the plant do not determine those of the truth",
        )
    return tuple(Disturbance(direction=S.T @ one.direction, signal=one.signal) for one in of_plant)
