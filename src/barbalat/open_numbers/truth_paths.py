"""Paths of studies that vary the simulated plant ([truth]): a number of the plant is changed in the simulated plant, and the
design stays the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from barbalat import validate
from barbalat.open_numbers.path import FieldPath, Key, Tables, copied
from barbalat.problem.parameters import Parameter
from barbalat.problem.plant import Plant
from barbalat.problem.state_feedback import Problem
from barbalat.problem.truth import Truth, names_simulated
from barbalat.validate import InputError

PARAMETERS = "parameters"
THETA = ("plant", "theta")
OF_THE_PLANT = ("A", "b")
"""Keys of [plant] from which designs follow."""
APART = (*OF_THE_PLANT, "x0", "disturbance", "unmatched")
"""Keys of [plant] that do not affect the simulated plant if [truth] has these keys too. The states of [truth] may differ."""


def is_parameter(path: FieldPath) -> bool:
    """Whether a path names a physical parameter, that is, its value in the truth: parameters.k or truth.parameters.k."""
    return path.keys[-2:-1] == (PARAMETERS,) and path.keys[:-2] in ((), ("truth",))


def own_keys(given: Tables | Problem) -> frozenset[str]:
    """The keys of ``APART`` for which the [truth] of a file, or the truth of a problem, has separate values."""
    if isinstance(given, Problem):
        return frozenset(key for key in APART if given.truth is not None and getattr(given.truth, key) is not None)
    truth = given.get("truth")
    return frozenset(APART).intersection(truth) if isinstance(truth, dict) else frozenset()


def put(tables: Tables, path: FieldPath, value: float, *, redesign: bool | None, own: frozenset[str]) -> None:
    """Put a number into the tables, at its place in [truth] if it belongs to the plant.

    redesign  with False, plant.A and plant.b are those of the truth. With True, they and the parameters change in the design as
              well, and everything is designed again. With None, plant.A and plant.b are those of the design, and parameters those
              of the truth
    own       the ``own_keys`` of the file. The numbers of these keys in [plant] belong to the design alone and are rejected if
              ``redesign`` is False
    """
    if is_parameter(path) and path.keys[0] == PARAMETERS and redesign:
        _redesign_with(tables, path, value)
        return
    place(tables, path, redesign=redesign, own=own).put(tables, value, said=path)


def place(tables: Tables, path: FieldPath, *, redesign: bool | None, own: frozenset[str]) -> FieldPath:
    """The place of the number that ``path`` varies (see ``put``); missing tables of [truth] are copied from [plant]."""
    if is_parameter(path):
        _require_declared(tables, path)
        plant, truth = tables.get("plant", {}), tables.get("truth", {})
        _require_simulated(path, names_simulated(plant | {"sensor": tables.get("sensor")}, truth))
        return FieldPath(("truth", PARAMETERS, str(path.keys[-1])))
    if path.keys[:2] == THETA and "A" in own and redesign is not None:
        raise InputError(f"{path} is not simulated, because [truth] gives the matrix A; vary truth.A")
    if path.keys[0] == "plant" and path.keys[1:2] and path.keys[1] in own:
        if redesign is False:
            raise _in_both(path, tables["truth"].get("states"), tables.get("labels", {}).get("names"))
        return path
    where = None if redesign else _in_the_truth(tables, path.keys, redesign is False)
    return path if where is None else FieldPath(where)


def is_of_the_design(problem: Problem, path: FieldPath) -> bool:
    """Whether a number of the plant, or a parameter, is not simulated because [truth] has separate numbers."""
    if is_parameter(path):
        physical = problem.plant.physical
        return physical is not None and path.keys[-1] not in names_simulated(vars(physical), vars(problem.truth or Truth()))
    return path.keys[0] == "plant" and len(path.keys) > 1 and path.keys[1] in own_keys(problem)


def with_own_input(tables: Tables) -> Tables:
    """The tables in which, if there is an observer, the plant's input is also in [truth], because the observer design contains
    the input."""
    plant, found = tables.get("plant"), copied(tables)
    if "observer" in tables and isinstance(plant, dict) and "input" in plant:
        _in_the_truth(found, ("plant", "input"), of_design=False)
    return found


def _in_both(path: FieldPath, states: Any, labels: Sequence[str] | None) -> InputError:
    """The error for a number of the plant for which [truth] has a separate value, with the path of that value.

    states  the truth's states, which translate indices of the plant's states into indices of the truth's; None if both have the
            same states
    labels  names of the plant's states; None for x_1, x_2, ...
    """
    key, *index = path.keys[1:]
    of_states = 0 if states is None else {"A": 2, "b": 1, "x0": 1}.get(str(key), 0)
    rows = [_row_of(i, states, labels) for i in index[:of_states]]
    known = (i for i in rows if i is not None)
    there = f"truth.{key}" if None in rows else str(FieldPath(("truth", key, *known, *index[of_states:])))
    design = ", or vary the design with --redesign" if key in OF_THE_PLANT else ""
    return InputError(f"{path} is not simulated, because [truth] gives {key}; vary {there}{design}")


def _row_of(i: Key, states: Any, labels: Sequence[str] | None) -> int | None:
    """The row of the plant's i-th state among the truth's states; None if the truth does not name it."""
    names = list(states) if all(isinstance(one, str) for one in states) else []
    if not isinstance(i, int) or (labels and i >= len(labels)):
        return None
    name = labels[i] if labels else f"x_{i + 1}"
    return names.index(name) if name in names else None


def _redesign_with(tables: Tables, path: FieldPath, value: float) -> None:
    """A parameter's nominal value, and its value in [truth] if there is one."""
    _require_declared(tables, path)
    name, truth = str(path.keys[-1]), tables.get("truth", {})
    own = truth.get(PARAMETERS, {}) if isinstance(truth, dict) else {}
    nominal = (PARAMETERS, name, "value") if isinstance(tables[PARAMETERS][name], dict) else (PARAMETERS, name)
    FieldPath(nominal).put(tables, value)
    if name in own:
        FieldPath(("truth", PARAMETERS, name)).put(tables, value)


def _require_declared(tables: Tables, path: FieldPath) -> None:
    declared = tables.get(PARAMETERS)
    require_parameter(path, declared if isinstance(declared, dict) else {})


def require_parameter(path: FieldPath, known: Mapping[str, Any]) -> None:
    """Raise InputError if the case has no parameter of this name."""
    name = str(path.keys[-1])
    if name not in known:
        there = f"the parameters are {', '.join(known)}" if known else "the case has no [parameters]"
        raise InputError(f"{path} does not name a parameter; {there}{validate.hint(name, known)}")


def _require_simulated(path: FieldPath, names: set[str]) -> None:
    if (name := str(path.keys[-1])) not in names:
        raise InputError(
            f"{path} is not simulated: no formula of the simulated plant contains {name}; use it in [truth], or vary the design "
            f"with --redesign"
        )


def _in_the_truth(tables: Tables, keys: tuple[Key, ...], of_design: bool) -> tuple[Key, ...] | None:
    """The place in [truth] of the value at ``keys``, with a copy of the value there; None if its place does not change."""
    plant, apart = tables.get("plant"), "truth" in tables or PARAMETERS in tables
    if not isinstance(plant, dict) or "transfer_function" in plant:
        return None
    truth = tables.get("truth", {})
    if not isinstance(truth, dict):
        return None
    if keys[0] == "sensor" and apart and ("sensor" in truth or PARAMETERS in tables):
        return _copied_to_truth(tables, "sensor", tables.get("sensor"), keys)
    if keys[0] != "plant" or len(keys) < 2:
        return None
    key = str(keys[1])
    if key in OF_THE_PLANT and (of_design or apart):
        return _copied_to_truth(tables, key, plant.get(key), keys[1:])
    follows = apart or "observer" in tables  # an observer contains the delay and the limits of the design
    if key == "input" and follows:
        return _copied_to_truth(tables, key, plant.get(key), keys[1:])
    return None


def _copied_to_truth(tables: Tables, key: str, own: Any, keys: tuple[Key, ...]) -> tuple[Key, ...] | None:
    truth = tables.setdefault("truth", {})
    if key not in truth:
        if own is None:
            return None if key in OF_THE_PLANT else ("truth", *keys)
        truth |= copied({key: own})
    return ("truth", *keys)


def placed(problem: Problem, path: FieldPath, value: float, *, redesign: bool | None, own: frozenset[str]) -> Problem | None:
    """The problem with a number of the truth or a parameter changed, for Python objects. None if the number is an ordinary
    field. See ``put`` for ``own``."""
    if is_parameter(path):
        return _with_parameter(problem, path, value, redesign is True and path.keys[0] == PARAMETERS)
    key = path.keys[1] if len(path.keys) > 1 else None
    truth = problem.truth or Truth()
    if path.keys[:2] == THETA and ("A" in own or problem.plant.physical is not None):
        instead = "truth.A" if "A" in own else "parameters or plant.A"
        raise InputError(f"{path} is not simulated, because [truth] gives the matrix A; vary {instead}")
    if redesign is False and path.keys[0] == "plant" and key in own:
        raise _in_both(path, truth.states, None if problem.labels is None else problem.labels.names)
    if path.keys[0] != "plant" or key not in OF_THE_PLANT or redesign is not False or not problem.plant.is_linear:
        return None
    simulated = problem.simulated
    standing = getattr(problem.plant if simulated is None else simulated, str(key))
    changed = standing.copy()
    index = path.keys[2:]
    shape = standing.shape
    if len(index) != len(shape) or not all(isinstance(i, int) and i < n for i, n in zip(index, shape, strict=True)):
        raise InputError(f"{path} does not name a number: plant.{key} has shape {' x '.join(map(str, shape))}, counted from 0")
    changed[index] = value
    return replace(problem, truth=replace(truth, **{str(key): changed}))


def _with_parameter(problem: Problem, path: FieldPath, value: float, redesign: bool) -> Problem:
    name, physical, truth = str(path.keys[-1]), problem.plant.physical, problem.truth or Truth()
    require_parameter(path, {} if physical is None else physical.nominal)
    assert physical is not None
    if not redesign:
        _require_simulated(path, names_simulated(vars(physical), vars(truth)))
        return replace(problem, truth=replace(truth, parameters={**truth.parameters, name: value}))
    moved = tuple(_moved(one, value) if one.name == name else one for one in physical.parameters)
    plant, own = problem.plant, dict(truth.parameters)
    if name in own:
        own[name] = value
    made = Plant(
        physical=replace(physical, parameters=moved), A_m=plant.A_m, scale=plant.scale, scale_from=plant.scale_from
    )  # fmt: skip
    derived = problem.derived is not None and problem.derived.used
    known = None if derived else problem.uncertainty, None if derived else problem.input_gain
    observer = problem.fixed_observer
    return replace(
        problem,
        plant=made,
        uncertainty=known[0],
        input_gain=known[1],
        truth=problem.truth and replace(truth, parameters=own),
        observer=observer and observer.design,
    )


def _moved(parameter: Parameter, value: float) -> Parameter:
    return replace(parameter, value=value)
