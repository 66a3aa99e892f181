"""The keys of a law's modifications: those of the modification's own settings, without a key that names it."""

from __future__ import annotations

from functools import cache
from typing import Any, get_args

from barbalat.adaptation.modifications import LEAKAGES, DeadZone, Leakage
from barbalat.cases.keys import Differences, Given, Key, keys_of
from barbalat.validate import InputError

MODIFICATIONS: dict[Any, tuple[type, ...]] = {Leakage: LEAKAGES, DeadZone: (DeadZone,)}
"""What a field may hold, by its type: one of these, chosen by the keys that are given."""

Choices = dict[str, tuple[type, ...]]
"""The fields of a law or a scheme that hold a modification, each with what it may be."""


class Modification:
    """modification = { ... }: the same keys stand in a law's own table."""


@cache
def _keys_of(kind: type) -> dict[str, Key]:
    """Return the keys of a modification's own settings."""
    return keys_of(kind, Differences())


def choices_of(keys: dict[str, Key]) -> Choices:
    """Which of these fields hold a modification."""
    types = {name: {key.type, *get_args(key.type)} for name, key in keys.items()}
    return {name: kinds for name, found in types.items() for asked, kinds in MODIFICATIONS.items() if asked in found}


def modification_keys(choices: Choices) -> dict[str, Key]:
    """The keys that choose and set the modifications; none is required."""
    found: dict[str, Key] = {}
    for kind in (kind for kinds in choices.values() for kind in kinds):
        keys = _keys_of(kind)
        for name, key in keys.items():
            others = " and ".join(other for other in keys if other != name)
            meaning = f"{found[name].meaning}; with {others} {key.meaning}" if name in found else key.meaning
            found[name] = key._replace(default=None, meaning=meaning)
    return found


def modified(given: Given, choices: Choices) -> Given:
    """What was given, with the modifications built from their keys."""
    own = {name for kinds in choices.values() for kind in kinds for name in _keys_of(kind)}
    rest = {key: value for key, value in given.items() if key not in own}
    return rest | {field: _chosen(given, kinds) for field, kinds in choices.items()}


def named_or_modified(given: Given, choices: Choices) -> Given:
    """Return the modification, which may also have been made already, under the name of its field."""
    named = {name: given.pop(name) for name in choices if name in given}
    return joined(
        named, {key: value for key, value in modified(given, choices).items() if key not in choices or value is not None}
    )


def joined(given: Given, more: Given) -> Given:
    """Both together; InputError for a modification that is given twice."""
    for name in given.keys() & more.keys():
        raise InputError(f"{name} is given twice, by its own name and by the keys of a modification")
    return given | more


def _chosen(given: Given, kinds: tuple[type, ...]) -> Any:
    """The one whose keys are given; ``None`` where none are."""
    keys = {kind: set(_keys_of(kind)) for kind in kinds}
    found = {key for kind in kinds for key in keys[kind] if key in given}
    if not found:
        return None
    for kind in kinds:
        if keys[kind] == found:
            return kind(**{key: given[key] for key in found})
    wider = [keys[kind] - found for kind in kinds if found < keys[kind]]
    if wider:
        raise InputError(f"{' and '.join(sorted(found))} goes with {' and '.join(sorted(wider[0]))}, which is missing")
    ways = ", or ".join(" with ".join(_keys_of(kind)) for kind in kinds)
    raise InputError(f"give either {ways}, got {', '.join(sorted(found))}")
