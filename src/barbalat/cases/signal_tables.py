"""The case file's keys for signals: commands and disturbances."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AliasChoices, Discriminator, Field, Tag

from barbalat.cases.tables import Table, Vector, how_many


class ConstantSignal(Table):
    """kind = "constant"."""

    kind: Literal["constant"]
    amplitude: float = Field(validation_alias=AliasChoices("amplitude", "value"))


class StepSignal(Table):
    """kind = "step"."""

    kind: Literal["step"]
    amplitude: float
    start: float = 0.0
    constant: float = 0.0


class StepsSignal(Table):
    """kind = "steps"."""

    kind: Literal["steps"]
    times: Vector
    values: Vector
    initial: float = 0.0


class SineSignal(Table):
    """kind = "sine"."""

    kind: Literal["sine"]
    amplitude: float
    frequency: float
    phase: float = 0.0
    constant: float = 0.0


class SinesSignal(Table):
    """kind = "sines"."""

    kind: Literal["sines"]
    amplitudes: Vector
    frequencies: Vector
    phases: Vector | None = None
    constant: float = 0.0


class SquareSignal(Table):
    """kind = "square"."""

    kind: Literal["square"]
    amplitude: float
    frequency: float
    phase: float = 0.0
    constant: float = 0.0


class ChirpSignal(Table):
    """kind = "chirp"."""

    kind: Literal["chirp"]
    amplitude: float
    frequency_start: float
    frequency_end: float
    duration: float
    constant: float = 0.0


class CsvSignal(Table):
    """kind = "csv": a column of times and a column of values; the path is relative to the case file."""

    kind: Literal["csv"]
    file: str = Field(validation_alias=AliasChoices("file", "path"))


Signal = Annotated[
    ConstantSignal | StepSignal | StepsSignal | SineSignal | SinesSignal | SquareSignal | ChirpSignal | CsvSignal,
    Field(discriminator="kind"),
]


OneOrSeveralSignals = Annotated[
    Annotated[Signal, Tag("one")] | Annotated[list[Signal], Tag("several")],
    Discriminator(how_many),
]
