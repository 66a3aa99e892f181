"""A table of a case file as a pydantic model: the types of its keys are checked here, their meaning in the constructors of the
objects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from types import GenericAlias
from typing import Annotated, Any, ClassVar, Union

from pydantic import BaseModel, ConfigDict, Discriminator, Tag, model_validator
from pydantic_core import PydanticCustomError

from barbalat.cases.keys import REQUIRED, Key, Make

FORMS = {"number": float, "vector": list[float], "matrix": list[list[float]]}
"""The forms of numbers, by their names in the locations of pydantic's findings."""
TAGS = (*FORMS, "one", "several", "a table", "names of states")
"""All names of forms that can occur in such a location."""


@dataclass(frozen=True, eq=False)
class Recipe:
    """The composition of a table, and the object made from it."""

    settings: type
    keys: dict[str, Key]
    make: Make
    choice: str = ""
    """The kind or scheme that selects this table among others."""
    elsewhere: set[str] = field(default_factory=set)
    """The keys of all these tables."""


class Table(BaseModel):
    """A table of a case file: unknown keys are rejected, and so is a text in place of a number."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

    recipe: ClassVar[Recipe]

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, given: Any) -> Any:
        """A misspelt key is often also a missing key; only the spelling is reported for this table."""
        if not isinstance(given, dict):
            return given
        keys = cls.recipe.keys
        aliases = {key.alias for key in keys.values()}
        details: dict[str, Any] = {"known": list(cls.model_fields), "choice": cls.recipe.choice, "given": list(given)}
        unknown = [key for key in given if key not in cls.model_fields and key not in aliases]
        for key in unknown:
            if key not in cls.recipe.elsewhere:
                raise PydanticCustomError("unknown_key", "unknown", {"key": key, **details})
        if unknown:
            required = [name for name, key in keys.items() if key.default is REQUIRED]
            missing = [name for name in required if name not in given and keys[name].alias not in given]
            raise PydanticCustomError("meaningless_key", "no meaning", {"key": unknown[0], "missing": missing, **details})
        return given


def numbers(forms: set[str]) -> Any:
    """A number, a list or a matrix, whichever of them ``forms`` allows."""
    if len(forms) == 1:
        return FORMS[next(iter(forms))]

    def form(value: Any) -> str:
        if not isinstance(value, list):
            looks = ("number", "vector")
        else:
            looks = ("matrix", "vector") if value and isinstance(value[0], list) else ("vector", "matrix")
        return looks[0] if looks[0] in forms else looks[1]

    return chosen({name: FORMS[name] for name in FORMS if name in forms}, form)


def one_or_several(one: Any) -> Any:
    """A table, or a list of such tables."""
    return chosen(
        {"one": one, "several": GenericAlias(list, (one,))}, lambda value: "several" if isinstance(value, list) else "one"
    )


def chosen(forms: dict[str, Any], choose: Callable[[Any], str]) -> Any:
    """One of several types, chosen by the value, so that findings are only about that type."""
    tagged = tuple(Annotated[form, Tag(name)] for name, form in forms.items())
    return Annotated[Union[tagged], Discriminator(choose)]  # noqa: UP007  # made at run time
