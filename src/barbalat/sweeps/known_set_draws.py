"""Draws over a case's known set: vectors uniform in the box or ball, input gains uniform in their intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from barbalat import validate
from barbalat.cases.build import Case
from barbalat.cases.load import CaseText
from barbalat.open_numbers.path import FieldPath, by_index
from barbalat.open_numbers.truth_paths import PARAMETERS, is_parameter, require_parameter
from barbalat.open_numbers.varied import VariedObjects, tables_with
from barbalat.problem.known_set import ParameterBall
from barbalat.problem.parameters import Parameter
from barbalat.problem.state_feedback import Problem
from barbalat.sweeps.spread import CutNormal, Distribution, InBall, LogUniform, Uniform, parse_distribution
from barbalat.validate import InputError

KNOWN_SET, BETWEEN = "known-set", "between"
"""The words that stand in place of a distribution and mean a draw from the known set or from the range of a physical
parameter."""
GAIN = "gain"
"""The last key of the path of an input's gain."""


def over_known_set(case: Case, path: FieldPath, stands_there: object) -> Mapping[FieldPath, Distribution]:
    """A distribution for each entry of the vector at ``path``, or for the input gain there; raises InputError if none fits."""
    problem = case.problem
    if path.keys[:2] == ("plant", "input") and path.keys[-1] == GAIN:
        return {path: _of_gain(problem, path)}
    if path.keys[0] == "parameters":
        raise InputError(f"{path} = {KNOWN_SET}: physical parameters are drawn from their ranges; write {path}={BETWEEN}")
    if stands_there is None:
        vector = "a vector of estimated parameters, such as plant.theta"
        raise InputError(f"the case has no {path}; {KNOWN_SET} needs {vector}")
    known = problem.uncertainty if isinstance(problem, Problem) else None
    shape = np.shape(stands_there) if isinstance(stands_there, (list, tuple, np.ndarray)) else ()
    if known is None or not shape or int(np.prod(shape)) != known.size:
        size = "the case has none" if known is None else f"{known.size} here"
        raise InputError(
            f"{path} = {KNOWN_SET} needs a vector with as many entries as the known set ({size}), or an input gain; got "
            f"{validate.show(stands_there)}"
        )
    entries = []
    for place in np.ndindex(*shape):
        entry = path
        for index in place:
            entry = entry.entry(index)
        entries.append(entry)
    if isinstance(known, ParameterBall):
        center = tuple(map(float, known.center))
        return {entry: InBall(center, known.radius, k) for k, entry in enumerate(entries)}
    ends = zip(entries, map(float, known.lower), map(float, known.upper), strict=True)
    return {entry: Uniform(low, high) for entry, low, high in ends if low < high}  # the others are known exactly


def _of_gain(problem: object, path: FieldPath) -> Uniform:
    gains = problem.known.gains if isinstance(problem, Problem) else None
    if gains is None:
        raise InputError(f"{path} = {KNOWN_SET} needs the interval of the input gain: give uncertainty.input_gain")
    which = path.keys[2] if isinstance(path.keys[2], int) else 0
    if which >= gains.size:
        raise InputError(f"{path} is out of range: the plant has {gains.size} inputs, numbered from 0")
    return Uniform(float(gains.lower[which]), float(gains.upper[which]))


def sampled(source: CaseText | Case, given: Sequence[tuple[str, str | Distribution]]) -> dict[FieldPath, Distribution]:
    """Pairs of path and distribution; a vector drawn over the case's known set becomes one distribution for each entry."""
    labels = (source if isinstance(source, Case) else source.case()).problem.labels if given else None
    found: dict[FieldPath, Distribution] = {}
    for place, distribution in given:
        path = FieldPath.parse(by_index(place, labels))
        if distribution == BETWEEN:
            found |= _new(found, over_ranges(source if isinstance(source, Case) else source.case(), path))
            continue
        if not isinstance(distribution, str):
            drawn: Mapping[FieldPath, Distribution] = {path: distribution}
        elif distribution == KNOWN_SET:
            case = source if isinstance(source, Case) else source.case()
            standing = (
                VariedObjects(source, (path,)).standing(path)
                if isinstance(source, Case)
                else path.of(tables_with(source, [path]))
            )
            drawn = over_known_set(case, path, standing)
        else:
            try:
                drawn = {path: parse_distribution(distribution)}
            except InputError as error:
                raise InputError(f"{path}: {error}") from None
        found |= _new(found, drawn)
    return found


def _new(found: Mapping[FieldPath, Distribution], drawn: Mapping[FieldPath, Distribution]) -> Mapping[FieldPath, Distribution]:
    if twice := [str(one) for one in drawn if one in found]:
        raise InputError(f"{twice[0]} is sampled twice")
    return drawn


def over_ranges(case: Case, path: FieldPath) -> dict[FieldPath, Distribution]:
    """A distribution for the parameter at ``path``, or one for each uncertain parameter if the path is ``parameters``; raises
    InputError for other paths."""
    physical = case.problem.plant.physical if isinstance(case.problem, Problem) else None
    known = {} if physical is None else {one.name: one for one in physical.parameters}
    if path.keys == (PARAMETERS,):
        uncertain = {FieldPath((PARAMETERS, name)): one for name, one in known.items() if not one.is_exact}
        if not uncertain:
            raise InputError(f"{path}={BETWEEN} needs [parameters] with ranges, but the case has none")
        return {one: spread_of(parameter) for one, parameter in uncertain.items()}
    if not is_parameter(path):
        raise InputError(f"{BETWEEN} needs a physical parameter, such as parameters.k={BETWEEN}, or all of them: got {path}")
    require_parameter(path, known)
    if known[str(path.keys[-1])].is_exact:
        raise InputError(f"{path}={BETWEEN} needs a range: the parameter is known exactly")
    return {path: spread_of(known[str(path.keys[-1])])}


def spread_of(parameter: Parameter) -> Distribution:
    """The parameter's distribution over its range."""
    low, high = parameter.range
    if parameter.distribution == "normal":
        return CutNormal(low, high)
    return LogUniform(low, high) if parameter.distribution == "loguniform" else Uniform(low, high)
