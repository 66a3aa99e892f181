"""Compares the simulated plant with the design plant and its declared sets, and lists the differences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.linear.systems import TransferFunction
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import EstimateSet, KnownSet, ParameterBall
from barbalat.problem.measurement import Sensor
from barbalat.problem.physical import projected, projection, rounding_of_rest
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.problem.truth import TruePlant
from barbalat.validate import Array

SAME_TO = 1e-9
"""Differences below this fraction of the largest number are attributed to the order of computation."""


@dataclass(frozen=True)
class Departure:
    """One difference, as a sentence about the simulated plant.

    within  whether the declared sets contain the difference, so guarantees over the sets hold for it
    """

    sentence: str
    within: bool = False

    def as_json(self) -> dict[str, Any]:
        return {"sentence": self.sentence, "within": self.within}


def departures(problem: Problem) -> list[Departure]:
    """Return all differences between the simulated plant and the design; the list is empty if they are the same."""
    simulated = problem.simulated
    if simulated is None:
        return []
    return [*_of_the_dynamics(problem, simulated), *_of_the_surroundings(problem), *_of_the_start(problem, simulated)]


def apart_sentence(found: Sequence[Departure]) -> str:
    """Return one sentence on all differences, or an empty text if there are none."""
    return f"the simulated plant ([truth]) differs from the design: {'; '.join(one.sentence for one in found)}" if found else ""


def sets_and_truth(problem: TrackingProblem) -> dict[str, Any]:
    """Return the blocks of JSON documents on the sets derived from ranges of parameters, and on the differences of the simulated
    plant."""
    if not isinstance(problem, Problem):
        return {}
    derived = {} if problem.derived is None else {"derived": problem.derived.as_json()}
    apart = {} if problem.simulated is None else {"truth": {"departures": [one.as_json() for one in departures(problem)]}}
    return derived | apart


def true_parameters(problem: Problem) -> Array | None:
    """Return theta (p,) of the simulated plant, by the weighted projection, followed by the input gains if they are unknown.

    The result is None if the states of the simulated plant differ.
    """
    simulated = problem.simulated
    if simulated is None:
        return problem.parameters
    if simulated.S is not None:
        return None
    theta, omega = _projected(problem, simulated)
    return theta if problem.input_gain is None else np.concatenate([theta, omega])


def _projected(problem: Problem, simulated: TruePlant) -> tuple[Array, Array]:
    """Return theta and omega for the simulated A and b, including the gains of the inputs. With a regressor, theta is
    unchanged."""
    plant, n = problem.plant, problem.plant.n
    scale = np.ones(n) if plant.scale is None else plant.scale
    A, b = _matrices(problem, simulated)
    omega = np.diag(projection(plant.b, scale) @ b.reshape(n, -1)) * [path.gain for path in problem.surroundings.paths]
    return projected(A, plant.A_m, plant.b, scale) if plant.is_linear else plant.theta, omega


def _matrices(problem: Problem, simulated: TruePlant) -> tuple[Array, Array]:
    """Return A and b of the simulated plant, with a baseline's states appended."""
    baseline = problem.plant.baseline
    return (simulated.A, simulated.b) if baseline is None else baseline.around(simulated.A, simulated.b)


def _of_the_dynamics(problem: Problem, simulated: TruePlant) -> Iterator[Departure]:
    plant = problem.plant
    yield from _of_the_parameters(problem, simulated)
    if simulated.S is not None:
        count = len(simulated.x0)
        other = f"it has {validate.counted(count, 'state')}, but the plant has {plant.states}"
        yield Departure("the plant's states are a matrix times its states" if count == plant.states else other)
    else:
        theta, omega = _projected(problem, simulated)
        yield from _of_theta(problem, theta)
        yield from _of_the_gain(problem, omega)
        yield from _of_the_rests(problem, simulated, theta)
    if simulated.friction:
        states = ", ".join(dict.fromkeys(simulated.names[row] for row, _, _ in simulated.friction))
        yield Departure(f"friction acts on {states}")
    if simulated.terms:
        yield Departure(f"further terms act on {', '.join(dict.fromkeys(simulated.names[row] for row, _ in simulated.terms))}")


def _of_the_parameters(problem: Problem, simulated: TruePlant) -> Iterator[Departure]:
    """Yield the parameters that are outside their ranges. If theta cannot be compared because the states differ, also yield the
    parameters that changed within their ranges.

    theta alone does not reveal parameters outside their ranges, because the known box also contains plants that cannot result
    from parameters within them.
    """
    for one in () if problem.plant.physical is None else problem.plant.physical.parameters:
        value, (low, high) = simulated.values[one.name], one.range
        said = f"its {one.name} is {value:.6g}"
        beyond = max(low - value, value - high)
        if beyond > SAME_TO * max(abs(low), abs(high)):
            declared = f"declared as {low:.6g}" if one.is_exact else f"outside its range [{low:.6g}, {high:.6g}]"
            replaced = problem.derived is not None and not problem.derived.used
            yield Departure(f"{said}, {declared}", within=replaced and simulated.S is None)
        elif simulated.S is not None and value != one.value:
            yield Departure(f"{said} (the plant's is {one.value:.6g}) and lies in its range", within=True)


def _of_theta(problem: Problem, theta: Array) -> Iterator[Departure]:
    own, known = problem.plant.theta, problem.uncertainty
    if same_values(theta, own):
        return
    said = f"its theta is {_shown(theta)} (the plant's is {_shown(own)})"
    if known is None:
        yield Departure(f"{said}, and no known set is declared")
    elif contains_up_to_rounding(known, theta):
        yield Departure(f"{said} and lies in the known set", within=True)
    else:
        yield Departure(f"{said} and lies outside the known set, {_of_set(known)}: projected estimates cannot reach it")


def same_values(one: Array, own: Array) -> bool:
    """Return whether theta, with or without the input's gains, equals that of the plant up to rounding errors."""
    return bool(np.abs(one - own).max() <= SAME_TO * max(1.0, float(np.abs(own).max())))


def contains_up_to_rounding(known: EstimateSet, values: Array) -> bool:
    """Return whether a set contains the values, up to the rounding errors of their computation."""
    beyond = np.abs(known.brought_in(values[None])[0] - values)
    return bool((beyond <= SAME_TO * np.maximum(1.0, np.abs(values))).all())


def _of_the_gain(problem: Problem, omega: Array) -> Iterator[Departure]:
    own = np.array([path.gain for path in problem.plant.paths])
    if np.abs(omega - own).max() <= SAME_TO * float(np.abs(own).max()):
        return
    said = f"its input gain is {_shown(omega)} (the plant's is {_shown(own)})"
    gains = problem.known.gains
    if gains is None:
        yield Departure(f"{said}, but the gain is declared as known")
    elif contains_up_to_rounding(gains, omega):
        yield Departure(f"{said} and lies in uncertainty.input_gain", within=True)
    else:
        yield Departure(f"{said} and lies outside uncertainty.input_gain, {_of_set(gains)}")


def _of_the_rests(problem: Problem, simulated: TruePlant, theta: Array) -> Iterator[Departure]:
    plant, n = problem.plant, problem.plant.n
    b = plant.b.reshape(n, -1)
    g = projection(plant.b, np.ones(n) if plant.scale is None else plant.scale)
    A, own_b = _matrices(problem, simulated)
    rest_A = A - plant.A_m - (b @ theta.reshape(n, -1).T if plant.is_linear else 0.0)
    rest_b = own_b.reshape(n, -1) - b * np.diag(g @ own_b.reshape(n, -1))
    sizes_b = np.abs(own_b.reshape(n, -1)) + np.abs(b)
    for name, rest, sizes in (("A", rest_A, np.abs(A) + np.abs(plant.A_m)), ("b", rest_b, sizes_b)):
        if (np.abs(rest) > rounding_of_rest(sizes, b, g)).any():
            yield Departure(
                f"{name} has an unmatched remainder of norm {np.linalg.norm(rest, 2):.3g}, which no theta and gain can produce"
            )


def _of_the_surroundings(problem: Problem) -> Iterator[Departure]:
    around = problem.surroundings
    for own, true in zip(problem.plant.paths, around.paths, strict=True):
        differs = [
            one.name
            for one in fields(PlantInput)
            if one.name != "gain" and not _same(getattr(own, one.name), getattr(true, one.name))
        ]
        if differs:
            said = ", ".join(f"{name} {_apart(getattr(true, name), getattr(own, name))}" for name in differs)
            yield Departure(f"the path before its input differs: {said}")
    if around.disturbance is not problem.disturbance:
        yield Departure("a different disturbance enters with u")
    if problem.truth is not None and problem.truth.unmatched is not None:
        yield Departure("other disturbances act on its states")
    simulated, designed = ((_lag(one), _noise(one), _resolution(one)) for one in (around.sensor, problem.sensor))
    fixed = problem.fixed_observer
    if problem.simulated is not None and problem.simulated.C is not None and fixed is not None:
        simulated_C, S = problem.simulated.C, problem.simulated.S
        if not np.array_equal(simulated_C, fixed.C if S is None else fixed.C @ S):
            yield Departure("its measured quantities differ from those that the observer expects")
    if simulated != designed:
        yield Departure("its state is measured by a different sensor")


def _apart(true: object, own: object) -> str:
    """Return both values with few digits, or with all digits if they would otherwise look the same."""
    short = [_of(true), _of(own)]
    return ", not ".join(short if short[0] != short[1] else [validate.show(true), validate.show(own)])


def _of(value: object) -> str:
    if value is None:
        return "none"
    if isinstance(value, TransferFunction):
        return ", ".join(f"{side} = {_listed(numbers)}" for side, numbers in (("num", value.num), ("den", value.den)))
    return _shown(np.asarray(value)) if isinstance(value, (int, float, tuple, np.ndarray)) else validate.show(value)


def _same(one: object, other: object) -> bool:
    if one is other or (one is None) != (other is None):
        return one is other
    if hasattr(one, "num") and hasattr(other, "num"):
        return _equal(one.num, other.num) and _equal(one.den, other.den)  # type: ignore[attr-defined]
    return _equal(one, other)


def _equal(one: object, other: object) -> bool:
    return bool(np.array_equal(np.asarray(one, dtype=float), np.asarray(other, dtype=float)))


def _lag(sensor: Sensor | None) -> float:
    return 0.0 if sensor is None else sensor.lag


def _resolution(sensor: Sensor | None) -> object:
    return None if sensor is None or sensor.quantization is None else np.ravel(sensor.quantization).tolist()


def _noise(sensor: Sensor | None) -> tuple[object, ...]:
    noise = None if sensor is None else sensor.noise
    if noise is None:
        return ()
    bound = None if noise.bound is None else np.ravel(noise.bound).tolist()
    return np.ravel(noise.std).tolist(), noise.sample_time, noise.seed, bound


def _of_the_start(problem: Problem, simulated: TruePlant) -> Iterator[Departure]:
    x0, own = (np.asarray(one, dtype=float) for one in (simulated.output(simulated.x0), problem.plant.x0))
    own = own[: problem.plant.states]
    if not np.allclose(x0, own, rtol=SAME_TO, atol=0.0):
        yield Departure(f"it starts at {_shown(x0)}, and the model at {_shown(own)}")


def _of_set(known: KnownSet) -> str:
    if isinstance(known, ParameterBall):
        return f"within {known.radius:.4g} of {_shown(known.center)}"
    return f"between {_shown(known.lower)} and {_shown(known.upper)}"


def _shown(values: Array) -> str:
    return f"{np.ravel(values)[0]:.4g}" if np.size(values) == 1 else _listed(values)


def _listed(values: Array) -> str:
    return f"[{', '.join(f'{one:.4g}' for one in np.ravel(values))}]"
