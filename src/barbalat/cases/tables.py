"""What the tables of a case file have in common."""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias

from pydantic import BaseModel, ConfigDict, Discriminator, Tag

Vector = list[float]
Matrix = list[list[float]]
SHAPES = ("number", "vector", "matrix", "one", "several")
"""What tells the forms of a value apart; pydantic names them in the places of its findings."""


def _shape(value: Any) -> str:
    if not isinstance(value, list):
        return "number"
    return "matrix" if value and isinstance(value[0], list) else "vector"


_Number: TypeAlias = Annotated[float, Tag("number")]
_Vector: TypeAlias = Annotated[Vector, Tag("vector")]
_Matrix: TypeAlias = Annotated[Matrix, Tag("matrix")]
Gain = Annotated[_Number | _Vector | _Matrix, Discriminator(_shape)]
"""A number, a diagonal or a matrix."""
VectorOrMatrix = Annotated[_Vector | _Matrix, Discriminator(lambda value: "matrix" if _shape(value) == "matrix" else "vector")]
NumberOrVector = Annotated[_Number | _Vector, Discriminator(lambda value: "number" if _shape(value) == "number" else "vector")]
NumberOrMatrix = Annotated[_Number | _Matrix, Discriminator(lambda value: "number" if _shape(value) == "number" else "matrix")]


def how_many(value: Any) -> str:
    """Whether a list of tables is given, or one."""
    return "several" if isinstance(value, list) else "one"


class Table(BaseModel):
    """A table of a case file: unknown keys are refused, and so is a text where a number is meant."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
