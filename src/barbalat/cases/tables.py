"""What the tables of a case file have in common."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

Vector = list[float]
Matrix = list[list[float]]
Gain = float | Vector | Matrix
"""A number, a diagonal or a matrix."""


class Table(BaseModel):
    """A table of a case file: unknown keys are refused, and so is a text where a number is meant."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
