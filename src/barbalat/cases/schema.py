"""The case file's tables as pydantic models, made from the registries and from the fields of the settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import is_dataclass
from functools import cache
from types import GenericAlias, NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import AfterValidator, AliasChoices, Field, create_model
from pydantic.json_schema import models_json_schema

from barbalat.adaptation.law import AdaptiveLaw, OutputErrorLaw
from barbalat.adaptation.laws import LAWS, OUTPUT_LAWS
from barbalat.adaptation.modifications import LEAKAGES, DeadZone, Leakage
from barbalat.cases.keys import REQUIRED, Context, Differences, Given, Key, Make, keys_of, summary
from barbalat.cases.problem_keys import DIFFERENCES as PROBLEM_DIFFERENCES
from barbalat.cases.scheme_keys import DIFFERENCES as SCHEME_DIFFERENCES
from barbalat.cases.scheme_keys import sampling_of
from barbalat.cases.table_models import Recipe, Table, chosen, numbers, one_or_several
from barbalat.controllers import SCHEMES
from barbalat.controllers.output import OUTPUT_SCHEMES
from barbalat.problem.baseline import BASELINES, Baseline
from barbalat.problem.faults import FAULTS, Fault
from barbalat.problem.observer import OBSERVERS, Observer
from barbalat.problem.output_feedback import OutputProblem
from barbalat.problem.regressors import REGRESSORS, Regressor
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Signal
from barbalat.signals import SIGNALS
from barbalat.solvers import SOLVERS, Tableau
from barbalat.solvers.tableau import AUTO
from barbalat.targets import IN_PAGES, in_pages, left_out
from barbalat.validate import Array, InputError, Matrix, Vector

REGISTRY_OF_TYPE: dict[Any, Mapping[str, type]] = {
    Signal: SIGNALS,
    Regressor: REGRESSORS,
    AdaptiveLaw: LAWS,
    OutputErrorLaw: OUTPUT_LAWS,
    Fault: FAULTS,
    Baseline: BASELINES,
    Observer: OBSERVERS,
}
"""The registry for each type of field: a table whose key ``kind`` selects the entry."""
NAMES_OF_TYPE: dict[Any, Mapping[str, Any]] = {Tableau: SOLVERS | {AUTO.name: AUTO}}
"""The registries for objects that a case file only names."""
CASES: dict[type, Mapping[str, type]] = {Problem: SCHEMES, OutputProblem: OUTPUT_SCHEMES}
"""The problems that a case file can pose, and the schemes that solve them."""
DIFFERENCES = PROBLEM_DIFFERENCES | SCHEME_DIFFERENCES

_NAME = Annotated[str, Field(min_length=1)]
_FORMS: dict[Any, set[str]] = {float: {"number"}, Vector: {"vector"}, Matrix: {"matrix"}, Array: {"vector", "matrix"}}


def problem_posed(data: Mapping[str, Any]) -> type:
    """The class of the problem that a case file poses: output feedback if the plant is a transfer function."""
    plant = data.get("plant")
    return OutputProblem if isinstance(plant, dict) and "transfer_function" in plant else Problem


def json_schema() -> dict[str, Any]:
    """The JSON Schema of case files, for editors; the problem decides which tables apply."""
    tables = {problem: case_table(problem) for problem in CASES}
    references, schema = models_json_schema([(table, "validation") for table in tables.values()])
    for name in WITH_FORMULAS:
        _allow_formulas(schema["$defs"][name]["properties"])
    chosen = {problem: references[table, "validation"] for problem, table in tables.items()}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "A case for Barbalat",
        "type": "object",
        "if": {"properties": {"plant": {"required": ["transfer_function"]}}, "required": ["plant"]},
        "then": chosen[OutputProblem],
        "else": chosen[Problem],
        **schema,
    }


WITH_FORMULAS = ("Plant", "PlantInput", "TransferFunction", "Sensor", "Noise", "Truth")
"""Tables in which a text in place of a number is a formula of physical parameters; the formula is evaluated before the table is
checked."""


def _allow_formulas(part: Any) -> None:
    """Allow texts in place of numbers in a JSON schema."""
    if isinstance(part, dict):
        if part.get("type") == "number":
            part["type"] = ["number", "string"]
        part = list(part.values())
    for inner in part if isinstance(part, list) else ():
        _allow_formulas(inner)


@cache
def case_table(problem: type, further: tuple[tuple[str, type], ...] = (), *, alone: bool = True) -> type[Table]:
    """The table of a whole case, by the problem that it poses.

    further  schemes in addition to the registered schemes: names and settings
    alone    whether no other controllers join those of the case, which then needs at least one
    """
    schemes = {**CASES[problem], **dict(further)}
    controllers = GenericAlias(list, (_one_of(schemes, "scheme"),))
    meaning = "the controllers that are compared on the problem, with a table [[controller]] for each"
    how = Field(min_length=1, description=meaning) if alone else Field(default_factory=list, description=meaning)
    return _model(_recipe(problem), controller=(controllers, how))


@cache
def table_of(settings: type, key: str = "", choice: str = "") -> type[Table]:
    """The table that makes an object of a class. It may be one of several tables, selected by ``key`` = "``choice``"."""
    more = {key: (Literal[choice], Field(description=_about(settings, key)))} if key else {}
    return _model(_recipe(settings, choice, is_scheme=key == "scheme"), **more)


def _about(settings: type, key: str) -> str:
    """What a kind or a scheme is, and what it can't be combined with."""
    further = left_out(settings) if key == "scheme" else ""
    if settings in SIGNALS.values():
        further = f"A page of explore keeps {IN_PAGES[in_pages(settings)]}."
    return " ".join([*summary(settings).split(), *further.split()])


def _recipe(settings: type, choice: str = "", *, is_scheme: bool = False) -> Recipe:
    """A field for a modification becomes the keys of its settings: in a law's table, or in a scheme's ``modification``."""
    differences = DIFFERENCES.get(settings, Differences())
    keys = keys_of(settings, differences)
    make: Make = differences.make or (lambda given, _: settings(**given))
    if is_scheme:
        sampling = sampling_of(keys)
        keys |= {"name": Key(_NAME, "in results, tables and pictures", keys["name"].default), **sampling}
    choices = choices_of(keys)
    if not choices:
        return Recipe(settings, keys, make, choice)
    meaning = "the modification of the law, given by its keys; none by default"
    keys |= {name: Key(_modification_of(name, kinds), meaning, None) for name, kinds in choices.items()}
    if not is_scheme:
        keys |= modification_keys(choices)
        return Recipe(settings, keys, lambda given, context: make(named_or_modified(given, choices), context), choice)
    table = _model(Recipe(Modification, modification_keys(choices), lambda given, _: modified(given, choices)))
    keys |= {"modification": Key(table, "the modification of the law, instead of the keys that name one; none by default", None)}

    def make_modified(given: Given, context: Context) -> Any:
        modifications = given.pop("modification", {})
        return make(joined(given, {name: value for name, value in modifications.items() if value is not None}), context)

    return Recipe(settings, keys, make_modified, choice)


def _modification_of(name: str, kinds: tuple[type, ...]) -> type[Table]:
    """Return the model of the TOML table for a modification; ``name`` is the field of the law or scheme that it fills."""
    choice = {name: kinds}
    return _model(Recipe(Modification, modification_keys(choice), lambda given, _: modified(given, choice)[name]))


def _model(recipe: Recipe, **more: Any) -> type[Table]:
    """The pydantic model of a table; ``more`` are keys that are not passed to its object."""
    definitions: dict[str, Any] = {key: _definition(key, given) for key, given in recipe.keys.items()}
    model = create_model(recipe.settings.__name__, __base__=Table, **more, **definitions)
    model.recipe = recipe
    return model


def _definition(name: str, key: Key) -> tuple[Any, Any]:
    details: dict[str, Any] = {"description": key.meaning}
    if key.alias is not None:
        details["validation_alias"] = AliasChoices(name, key.alias)
    if isinstance(key.default, (bool, int, float, str)):
        details["default"] = key.default
    elif key.default is not REQUIRED:
        details["default_factory"] = lambda: None  # the settings have defaults, so the JSON Schema states none
    return form(key.type), Field(**details)


def members_of(hint: Any) -> list[Any]:
    """The types that a field may have other than ``None``."""
    return [one for one in (get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)) if one is not NoneType]


def form(hint: Any) -> Any:
    """The type of a field of settings as pydantic checks it."""
    members = members_of(hint)
    if all(one in _FORMS for one in members):
        return numbers(set().union(*(_FORMS[one] for one in members)))
    if float in members and all(one is float or is_dataclass(one) for one in members):
        (table,) = (one for one in members if one is not float)
        return chosen(
            {"number": float, "a table": table_of(table)}, lambda value: "a table" if isinstance(value, dict) else "number"
        )
    lists = [one for one in members if get_origin(one) is tuple]
    if lists and len(members) == 1:
        return GenericAlias(list, (form(get_args(lists[0])[0]),))
    if lists:
        return one_or_several(form(next(one for one in members if one not in lists)))
    kinds = {name: settings for one in members for name, settings in REGISTRY_OF_TYPE.get(one, {}).items()}
    if kinds:
        return _one_of(kinds, "kind")
    (member,) = members
    if member in NAMES_OF_TYPE:
        names = NAMES_OF_TYPE[member]
        return Annotated[Literal[tuple(names)], AfterValidator(names.__getitem__)]
    if isinstance(member, type) and is_dataclass(member):
        return table_of(member)
    is_table = isinstance(member, type) and issubclass(member, Table)
    if is_table or member in (bool, int, str) or get_origin(member) in (Annotated, Literal):
        return member
    if get_origin(member) is Mapping:
        key, value = get_args(member)
        return GenericAlias(dict, (key, form(value) if any(map(is_dataclass, members_of(value))) else value))
    unknown = TypeError(f"no case file form is known for {hint}")
    unknown.add_note("cases/scheme_keys.py can define its keys")
    raise unknown


def _one_of(registry: Mapping[str, type], key: str) -> Any:
    """One of the tables of a registry, selected by ``key``."""
    tables = [table_of(settings, key, name) for name, settings in registry.items()]
    for table in tables:
        table.recipe.elsewhere.update(name for other in tables for name in other.recipe.keys)
    return Annotated[Union[tuple(tables)], Field(discriminator=key)]  # noqa: UP007  # made at run time


MODIFICATIONS: dict[Any, tuple[type, ...]] = {Leakage: LEAKAGES, DeadZone: (DeadZone,)}
"""Fields of these types take an instance of one of these classes; the keys in the case file select which."""

Choices = dict[str, tuple[type, ...]]
"""The fields of a law or a scheme that take a modification, each with its possible values."""


class Modification:
    """modification = { ... }; the same keys are part of the table of a law."""


@cache
def _keys_of(kind: type) -> dict[str, Key]:
    """Return the keys of the settings of a modification."""
    return keys_of(kind, Differences())


def choices_of(keys: dict[str, Key]) -> Choices:
    """The fields that contain a modification."""
    types = {name: {key.type, *get_args(key.type)} for name, key in keys.items()}
    return {name: kinds for name, found in types.items() for asked, kinds in MODIFICATIONS.items() if asked in found}


def modification_keys(choices: Choices) -> dict[str, Key]:
    """The keys that select and set the modifications; none is required."""
    found: dict[str, Key] = {}
    for kind in (kind for kinds in choices.values() for kind in kinds):
        keys = _keys_of(kind)
        for name, key in keys.items():
            others = " and ".join(other for other in keys if other != name)
            meaning = f"{found[name].meaning}; with {others} {key.meaning}" if name in found else key.meaning
            found[name] = key._replace(default=None, meaning=meaning)
    return found


def modified(given: Given, choices: Choices) -> Given:
    """The given values, with the modifications built from their keys."""
    own = {name for kinds in choices.values() for kind in kinds for name in _keys_of(kind)}
    rest = {key: value for key, value in given.items() if key not in own}
    return rest | {field: _chosen(given, kinds) for field, kinds in choices.items()}


def named_or_modified(given: Given, choices: Choices) -> Given:
    """Return the modification, which may already have been made, under the name of its field."""
    named = {name: given.pop(name) for name in choices if name in given}
    return joined(
        named, {key: value for key, value in modified(given, choices).items() if key not in choices or value is not None}
    )


def joined(given: Given, more: Given) -> Given:
    """Return both combined; raises InputError for a modification that is given twice."""
    for name in given.keys() & more.keys():
        raise InputError(f"{name} is given twice, under its name and by the keys of a modification")
    return given | more


def _chosen(given: Given, kinds: tuple[type, ...]) -> Any:
    """The modification whose keys are given; ``None`` if no keys are given."""
    keys = {kind: set(_keys_of(kind)) for kind in kinds}
    found = {key for kind in kinds for key in keys[kind] if key in given}
    if not found:
        return None
    for kind in kinds:
        if keys[kind] == found:
            return kind(**{key: given[key] for key in found})
    wider = [keys[kind] - found for kind in kinds if found < keys[kind]]
    if wider:
        verb = "needs" if len(found) == 1 else "need"
        raise InputError(f"{' and '.join(sorted(found))} {verb} {' and '.join(sorted(wider[0]))}, which is missing")
    ways = ", or ".join(" with ".join(_keys_of(kind)) for kind in kinds)
    raise InputError(f"give either {ways}, got {', '.join(sorted(found))}")
