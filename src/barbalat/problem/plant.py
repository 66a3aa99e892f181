"""The plant (1) and the reference model (2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from barbalat import budget, validate
from barbalat.budget import Estimate
from barbalat.linear.conditions import largest_real_part, require_controllable, require_hurwitz
from barbalat.linear.pole_placement import place
from barbalat.linear.systems import open_loop
from barbalat.problem.actuation import PlantInput
from barbalat.problem.baseline import Baseline, FixedController
from barbalat.problem.from_ranges import FromRanges, from_ranges
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.physical import PhysicalPlant, holds_formulas, input_matrix, projected, rounding_of_rest
from barbalat.problem.regressors import Linear, MatchedTerm, Regressor
from barbalat.protocols import Value
from barbalat.settings import Settings, one_line
from barbalat.validate import Array, InputError, Matrix, Vector, freeze


@dataclass(frozen=True, eq=False, init=False)
class Plant(Settings):
    """The plant with matched uncertainty, x' = A_m x + b (theta'phi(x) + u + d), x(0) = x0, which is eq. (1) for phi(x) = x.

    A_m        (n, n)  known, Hurwitz, [1/s]
    b          (n,)    known, or (n, m) for m inputs; (A_m, b) controllable
    theta      (p,)    the true parameters, or (p, m), stored row by row as (p m,); controllers do not know them
    x0         (n,)    initial state, measured; zero by default
    input              the path before the input: limits, unmodelled dynamics, delay, eq. (11); none by default. With several
                       inputs, one PlantInput for all inputs, or a list with one for each; all have the same delay
    regressor          phi(x), (p,), known: x by default

    Alternatively, give x' = A x + b (u + d) by A and b, with A_m or the ``poles`` that state feedback assigns to it. theta then
    solves the matching condition A = A_m + b theta', and phi(x) = x. A complex pole is given once, as [real, imaginary].

    Alternatively, give x' = A x + b (u + d) with a ``baseline``, a fixed controller such as an ``LqiBaseline``. A_m is the closed
    loop of the baseline and this plant. The state in A_m, b, theta and x0 is x followed by the states of the baseline, [x; xi].

    Raises InputError for wrong shapes, a non-Hurwitz A_m, an uncontrollable pair, and if no theta satisfies the matching
    condition; the message then gives the unmatched remainder.
    """

    A_m: Matrix
    b: Array
    theta: Array
    x0: Vector | None = None
    input: PlantInput | tuple[PlantInput, ...] | None = None
    regressor: Regressor = field(default_factory=Linear)
    physical: PhysicalPlant | None = field(default=None, repr=False)
    scale: Vector | None = field(default=None, repr=False)
    scale_from: str = field(default="as given", repr=False)
    baseline: FixedController | None = field(default=None, repr=False)
    nominal_A: Matrix | None = field(default=None, repr=False)  # (n, n) of the plant's own states: plant.A as given
    declared: bool = field(default=False, repr=False)  # whether the parameters declare it, apart from the simulated plant
    __repr__ = one_line

    def __init__(
        self,
        A_m: Matrix | None = None,
        b: Array = None,
        theta: Array | None = None,
        x0: Vector | None = None,
        *,
        input: PlantInput | Sequence[PlantInput] | None = None,
        regressor: Regressor | None = None,
        A: Matrix | None = None,
        poles: Sequence[Any] | None = None,
        physical: PhysicalPlant | None = None,
        scale: Vector | None = None,
        scale_from: str = "as given",
        baseline: Baseline | FixedController | None = None,
        nominal_A: Matrix | None = None,
        declared: bool = False,
    ) -> None:
        if physical is None and holds_formulas((A, b, x0, input)):
            physical = PhysicalPlant(A=A, b=b, x0=x0, input=input)  # type: ignore[arg-type]  # refuses other texts
        posed = isinstance(baseline, Baseline) and baseline.anti_windup is not None
        if theta is None:
            nominal_A = A if physical is None else physical.matrices(physical.nominal)[0]
        if physical is not None and theta is None:
            A_m, b, theta, x0, input, baseline = _nominal(physical, A_m, poles, scale, baseline)
        elif b is None:
            raise InputError.of("plant.b", "is missing")
        elif A is not None and baseline is not None:
            _require_alone(A_m, theta, regressor, poles)
            A_m, b, theta, baseline = _around(baseline, A, b)
        elif A is not None:
            A_m, b, theta = _from_open_loop(A, b, A_m, theta, regressor, poles)
        elif A_m is None or theta is None:
            missing = "A_m" if A_m is None else "theta"
            raise InputError.of(
                f"plant.{missing}", "is missing, got None: give A_m, b and theta, or A, b and either A_m or poles"
            )
        elif poles is not None:
            raise InputError("poles needs plant.A, which is missing")
        freeze(self, A_m=A_m, b=b, theta=theta, x0=x0, input=input, regressor=Linear() if regressor is None else regressor)
        if baseline is not None and not isinstance(baseline, FixedController):
            raise InputError("baseline needs plant.A, which is missing")
        freeze(self, physical=physical, scale=scale, scale_from=scale_from, baseline=baseline, nominal_A=nominal_A)
        freeze(self, declared=declared or physical is not None)
        self.__post_init__()
        if posed and all(path.saturation is None for path in self.paths):
            raise InputError.of("baseline.anti_windup", "acts at the input limits: give plant.input.saturation, which is missing")

    def __post_init__(self) -> None:
        A_m = validate.square_matrix("plant.A_m", self.A_m)
        n = A_m.shape[0]
        budget.require(
            "plant.A_m",
            n,
            of_plant,
            given=f"is {n} x {n} and its checks",
            fits=lambda most: f"at most {validate.counted(most, 'state')}",
            what=f"the checks of a plant of {validate.counted(n, 'state')}",
        )
        validate.instance("plant.regressor", self.regressor, Regressor)
        freeze(
            self,
            A_m=A_m,
            b=input_matrix("plant.b", self.b, n),
            x0=self._whole("plant.x0", np.zeros(n) if self.x0 is None else self.x0, 0.0),
        )
        freeze(self, theta=parameters("plant.theta", self.theta, self.regressor.size(n), self.inputs))
        if self.input is not None:
            freeze(self, input=inputs_of("plant.input", self.input, self.inputs))
        if self.nominal_A is not None:
            freeze(self, nominal_A=validate.square_matrix("plant.A", self.nominal_A, self.states))
        if self.scale is not None:
            freeze(self, scale=sizes_of_states(self._whole("plant.scale", self.scale, 1.0), n))
        _require_sound(A_m.tobytes(), self.b.tobytes(), self.b.shape)

    def _whole(self, field: str, given: Any, own: float) -> Array:
        """Return (n,) from n numbers, or from the numbers of the plant's states followed by ``own`` for the baseline's states."""
        n, xi = len(self.A_m), 0 if self.baseline is None else self.baseline.order
        if xi and np.size(given) == n:
            return validate.vector(field, given, n)
        return np.concatenate([validate.vector(field, given, n - xi), np.full(xi, own)])

    @classmethod
    def from_system(
        cls, system: Any, *, A_m: Matrix | None = None, poles: Sequence[Any] | None = None, x0: Vector | None = None,
        input: PlantInput | Sequence[PlantInput] | None = None,
    ) -> Plant:  # fmt: skip
        """Return the plant x' = A x + B u from a state space of python-control or SciPy, or from a pair (A, B).

        Its state is measured, so C and D are ignored. A plant with a measured output is an ``OutputPlant``.
        """
        A, B = open_loop("plant", system)
        return cls(A=A, b=B, A_m=A_m, poles=poles, x0=x0, input=input)

    @property
    def A(self) -> Array:
        """A_m + b theta' (n, n), which is the linear part of x' if phi(x) = x."""
        if not self.is_linear:
            raise InputError("a plant with a nonlinear regressor has no matrix A")
        return self.A_m + self.b.reshape(self.n, -1) @ self.theta.reshape(self.n, -1).T

    @property
    def nominal_theta(self) -> Array | None:
        """theta (n m,) at the declared values of the parameters.

        It is None with a baseline, which is designed for these values, and without parameters, because plant.A may then be the
        simulated plant, which no controller knows.
        """
        if not self.declared or self.nominal_A is None or self.baseline is not None:
            return None
        return projected(self.nominal_A, self.A_m, self.b, np.ones(self.n) if self.scale is None else self.scale)

    @cached_property
    def from_ranges(self) -> FromRanges | None:
        """The bounds on theta and the input gain from ranges of physical parameters; None for a plant without ranges."""
        if self.physical is None:
            return None
        scale, said = (np.ones(self.n), "which are 1 each") if self.scale is None else (self.scale, self.scale_from)
        numbers = self.A_m.tobytes(), self.b.tobytes(), self.b.shape, scale.tobytes()
        return _of_ranges(self.physical, self.baseline, *numbers, said)

    @property
    def n(self) -> int:
        """The dimension of the state, including the states of a baseline."""
        return len(self.b)

    @property
    def states(self) -> int:
        """The number of the plant's states, without those of a baseline. They are measured."""
        return self.n if self.baseline is None else self.n - self.baseline.order

    @property
    def open_loop(self) -> tuple[Array, Array]:
        """A and b of the plant without the states of a baseline."""
        return self.A[: self.states, : self.states], self.b[: self.states]

    @property
    def enters(self) -> Array | None:
        """The matrix by which the command enters the states of a baseline: (n,), with m inputs (n, q); None without a
        baseline."""
        return None if self.baseline is None or not self.baseline.order else self.baseline.enters

    @property
    def inputs(self) -> int:
        """The number of control inputs."""
        return 1 if self.b.ndim == 1 else int(self.b.shape[1])

    @property
    def paths(self) -> tuple[PlantInput, ...]:
        """The path before each input."""
        if self.input is None:
            return (_DIRECT,) * self.inputs
        return self.input if isinstance(self.input, tuple) else (self.input,)

    @property
    def outputs(self) -> int:
        """The number of measured quantities, which are all states."""
        return self.states

    @property
    def is_linear(self) -> bool:
        """Whether phi(x) = x."""
        return isinstance(self.regressor, Linear)

    def derivative(self, x: Value, v: Value) -> Value:
        """Return x' for the matched input v, which is the part of u that reaches the plant, plus d."""
        phi = MatchedTerm(self.regressor, self.inputs).phi(x)
        return self.A_m @ x + np.dot(self.b, phi.T @ self.theta + v)  # (1)

    def output(self, x: Value) -> Value:
        """Return the measurement, which is the state."""
        return x


def of_plant(states: float) -> Estimate:
    """Return the cost of checking a plant with this number of states, which is 1 s for 200 and 13 s for 400."""
    return Estimate(memory=100.0 * states**2, seconds=5e-10 * states**4)


@lru_cache(maxsize=64)  # the plants of an ensemble mostly share both
def _require_sound(A_m: bytes, b: bytes, shape: tuple[int, ...]) -> None:
    matrix = np.frombuffer(A_m).reshape(shape[0], shape[0])
    require_hurwitz("plant.A_m", matrix)
    require_controllable("(plant.A_m, plant.b)", matrix, np.frombuffer(b).reshape(shape))


@lru_cache(maxsize=64)  # studies vary the path before the input far more often than the ranges
def _of_ranges(
    physical: PhysicalPlant,
    baseline: FixedController | None,
    A_m: bytes,
    b: bytes,
    shape: tuple[int, ...],
    scale: bytes,
    said: str,
) -> FromRanges:
    matrix, entries, sizes = np.frombuffer(A_m).reshape(shape[0], shape[0]), np.frombuffer(b).reshape(shape), np.frombuffer(scale)
    if baseline is None:
        return from_ranges(physical, matrix, entries, sizes, said)
    found = from_ranges(baseline.around_formulas(physical), matrix, entries, sizes, said)
    nominal = baseline.theta  # the baseline's gains on its own states are known, up to the rounding errors of A_m
    hull = ParameterBox(lower=np.minimum(found.theta.lower, nominal), upper=np.maximum(found.theta.upper, nominal))
    return replace(found, theta=hull, physical=physical)


_DIRECT = PlantInput()
"""The input without actuator, through which u reaches the plant unchanged."""


def _from_open_loop(A: Any, b: Any, A_m: Any, theta: Any, regressor: Any, poles: Any) -> tuple[Array, Array, Array]:
    """Return A_m, b and theta of x' = A x + b u."""
    for name, given in (("theta", theta), ("regressor", regressor)):
        if given is not None:
            raise InputError.of(
                "plant.A", f"and plant.{name} are both given; with plant.A theta follows, and the regressor is the state"
            )
    if (A_m is None) == (poles is None):
        raise InputError("give either A_m or poles of the reference model with plant.A")
    if A_m is None:
        A = validate.square_matrix("plant.A", A)
        A_m = place(A, input_matrix("plant.b", b, len(A)), poles)
    A_m = validate.square_matrix("reference_model.A_m", A_m)
    return A_m, b, matching_parameters(A, A_m, b)


def matching_parameters(A: Any, A_m: Array, b: Any) -> Array:
    """Return the theta (n m,) for which A = A_m + b theta'. Raises InputError, with the unmatched remainder, if there is none."""
    n = A_m.shape[0]
    A = validate.square_matrix("plant.A", A, n)
    b = input_matrix("plant.b", b, n)
    if not b.any():
        raise InputError.of("plant.b", "must not be zero")
    difference = A - A_m
    scale = np.abs(b).max()  # scaled, because squares of extreme entries may overflow
    directions = (b / scale).reshape(n, -1)
    along = np.linalg.lstsq(directions, difference, rcond=None)[0]  # (m, n)
    rest = difference - directions @ along
    if (np.abs(rest) > rounding_of_rest(np.abs(A) + np.abs(A_m), directions, np.linalg.pinv(directions))).any():
        raise InputError(
            "plant.A - reference_model.A_m "
            f"must be matched (equal to b theta' for some theta), but the part {validate.show(rest)} is outside the range "
            f"of b = {validate.show(b)}"
        )
    with np.errstate(over="ignore"):  # the constructor rejects an infinite theta
        return np.asarray((along / scale).T.reshape(-1))


def parameters(field: str, theta: Any, p: int, m: int) -> Array:
    """Return theta as (p m,), from that shape or from (p, m)."""
    if validate.dimensions(theta) == 2:
        return validate.vector(field, validate.array(field, theta, (p, m)).reshape(-1))
    return validate.vector(field, theta, p * m)


def _require_alone(A_m: Any, theta: Any, regressor: Any, poles: Any) -> None:
    given = {"reference_model.A_m": A_m, "plant.theta": theta, "plant.regressor": regressor, "reference_model.poles": poles}
    for name, value in given.items():
        if value is not None:
            raise InputError.of(name, "and baseline are both given; the model is the nominal plant with the baseline")


def _around(baseline: Baseline | FixedController, A: Any, b: Any) -> tuple[Array, Array, Array, FixedController]:
    """Return A_m, b and theta for the state with the baseline's own states appended, and the baseline for this plant."""
    A = validate.square_matrix("plant.A", A)
    b = input_matrix("plant.b", b, len(A))
    validate.instance("baseline", baseline, (Baseline, FixedController))
    fixed = baseline if isinstance(baseline, FixedController) else baseline.on(A, b)
    A_z, b_z = fixed.around(A, b)
    A_m = A_z - b_z.reshape(len(A_z), -1) @ fixed.K
    largest, stable = largest_real_part(A_m)
    if not stable:
        real_part = f"real part {largest:.6g}" if largest > 0 else "real part 0, up to rounding"
        raise InputError.of("baseline", f"does not stabilise the nominal plant: an eigenvalue of its loop has {real_part}")
    return A_m, b_z, fixed.theta, fixed


def _nominal(
    physical: PhysicalPlant, A_m: Any, poles: Any, scale: Any, baseline: Any
) -> tuple[Array, Array, Array, Any, Any, FixedController | None]:
    """Return A_m, b, theta, x0 and input of the plant at its nominal parameters. theta results from the weighted projection."""
    if baseline is not None:
        _require_alone(A_m, None, None, poles)
        at = physical.nominal
        A_m, b, theta, fixed = _around(baseline, *physical.matrices(at))
        return A_m, b, theta, physical.initial(at), physical.inputs(at), fixed
    if (A_m is None) == (poles is None):
        raise InputError("give either A_m or poles of the reference model with plant.A")
    A, b = physical.matrices(physical.nominal)
    if not b.any():
        raise InputError.of("plant.b", "must not be zero at the nominal parameters")
    A_m = place(A, b, poles) if A_m is None else validate.square_matrix("reference_model.A_m", A_m, len(A))
    weights = np.ones(len(A)) if scale is None else sizes_of_states(scale, len(A))
    at = physical.nominal
    return A_m, b, projected(A, A_m, b, weights), physical.initial(at), physical.inputs(at), None


def sizes_of_states(scale: Any, n: int) -> Array:
    """Return the scale of each state (n,)."""
    found = validate.vector("plant.scale", scale, n)
    if not (found > 0).all():
        raise InputError.of("plant.scale", f"must be positive, one for each state, got {validate.show(scale)}")
    return found


def inputs_of(field: str, given: Any, m: int) -> Any:
    """Return one PlantInput for one input, or a tuple of m of them."""
    several = tuple(given) if isinstance(given, (list, tuple)) else (given,) * m
    for path in several:
        validate.instance(field, path, PlantInput)
    if len(several) != m or any(path.delay != several[0].delay for path in several):
        raise InputError.of(
            field, f"must be one value for all inputs, or a list of {m} values with the same delay, got {len(several)}"
        )
    return several[0] if m == 1 else several


@dataclass(frozen=True, eq=False)
class Model:
    """The reference model as a separate system, which the loop integrates with the plant."""

    A_m: Array
    b: Array
    k_0: Array | float
    x0: Array
    enters: Array | None = None  # the matrix by which the command enters the state directly
    states: int | None = None  # the number of the plant's states, if a baseline's states follow them

    def derivative(self, x_m: Value, r: Value) -> Value:
        rate = self.A_m @ x_m + np.dot(self.b, np.dot(self.k_0, r))  # (2)
        return rate if self.enters is None else rate + np.dot(self.enters, r)

    def output(self, x_m: Value) -> Value:
        """Return the part of the model's state that the plant's output should follow."""
        return x_m if self.states is None else x_m[: self.states]

    def remedy(self, gain: float) -> str | None:
        """Return the k_0 with which the model would settle at the command, if it now settles at ``gain`` times the command."""
        return None if gain == 0 or np.ndim(self.k_0) > 0 or self.states is not None else f"k_0 = {self.k_0 / gain:.6g}"

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        """A, B, C with x_m' = A x_m + B r and the output C x_m."""
        n = len(self.b)
        B = self.b.reshape(n, -1) @ np.atleast_2d(self.k_0)
        return self.A_m, B if self.enters is None else B + self.enters.reshape(n, -1), np.eye(self.states or n, n)


AT_REST = 1e-9
"""Fraction of the model's largest steady-state gain below which a state's response to a constant command is rounding."""


@dataclass(frozen=True, eq=False)
class ReferenceModel(Settings):
    """The reference model x_m' = A_m x_m + b k_0 r, x_m(0) = x(0), eq. (2). A_m and b are those of the plant.

    k_0     a number; with m inputs a matrix (m, q) for q commands. A case file gives k_0 or ``follow``; 1 by default in Python
    follow  instead of k_0: the state, by its label or as "x_1", that settles at a constant command; with m inputs a list of m
            states, one for each of m commands. k_0 follows from A_m and b
    """

    k_0: float | Matrix | None = None
    follow: str | tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if self.follow is not None:
            self._check_follow()
            return
        name, k_0 = "reference_model.k_0", 1.0 if self.k_0 is None else self.k_0
        matrix = isinstance(k_0, (list, tuple)) or validate.dimensions(k_0) > 0
        freeze(self, k_0=validate.array(name, k_0, (None, None)) if matrix else validate.number(name, k_0))

    def _check_follow(self) -> None:
        name = "reference_model.follow"
        if self.k_0 is not None:
            raise InputError.of("reference_model.k_0", f"and {name} are both given; k_0 follows from the state to follow")
        if isinstance(self.follow, (list, tuple)):
            freeze(self, follow=tuple(validate.line(name, one) for one in self.follow))
        else:
            freeze(self, follow=validate.line(name, self.follow))

    def gain(self, plant: Plant, states: Sequence[str]) -> Array | float:
        """Return k_0 as given, or compute it so that the chosen ``states`` of the plant settle at a constant command.

        Raises InputError for an unknown state, for a number of states other than the number of inputs, and for states that cannot
        settle at arbitrary constant commands.
        """
        if self.follow is None:
            assert self.k_0 is not None
            return self.k_0
        name, m = "reference_model.follow", plant.inputs
        followed = (self.follow,) if isinstance(self.follow, str) else self.follow
        if len(followed) != m:
            raise InputError.of(name, f"must name {validate.counted(m, 'state')}, one for each input, got {len(followed)}")
        for state in followed:
            if state not in states:
                raise InputError.of(name, f"names no state, got {validate.show(state)}; the states are {', '.join(states)}")
        at_rest = -np.linalg.solve(plant.A_m, plant.b.reshape(plant.n, m))  # x_m = at_rest k_0 r
        gains = at_rest[[states.index(state) for state in followed]]
        if np.linalg.svd(gains, compute_uv=False).min() <= AT_REST * np.abs(at_rest).max():
            told = "comes to rest at 0" if m == 1 else "come to rest at values that depend on each other"
            raise InputError.of(name, f"names {', '.join(followed)}, which {told} under every constant command")
        return 1.0 / float(gains[0, 0]) if m == 1 else np.linalg.inv(gains)

    def require_commands(self, plant: Plant, k_0: Array | float, commands: int) -> None:
        """Raise InputError unless this gain takes this number of commands to the plant's inputs."""
        if plant.inputs == 1 and commands != 1:
            raise InputError.of("reference", f"must be a single command for a plant with one input, got {commands}")
        wanted = (plant.inputs, commands) if plant.inputs > 1 else ()
        if np.shape(k_0) == wanted:
            return
        asked = f"a matrix {wanted[0]} x {wanted[1]} (inputs x commands)" if wanted else "a number"
        if self.follow is not None:
            raise InputError.of("reference", f"must be {plant.inputs} commands, one for each followed state, got {commands}")
        raise InputError.of("reference_model.k_0", f"must be {asked}, got {validate.show(k_0)}")
