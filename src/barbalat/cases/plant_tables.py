"""The case file's keys for the plant, its input, its measurement, the model and the known set."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from barbalat.cases.signal_tables import Signal
from barbalat.cases.tables import Matrix, NumberOrMatrix, NumberOrVector, Table, Vector, VectorOrMatrix, how_many


class TransferFunctionTable(Table):
    """{ num = [...], den = [...] }, highest power first."""

    num: Vector
    den: Vector


class InputTable(Table):
    """[plant.input]."""

    quantization: float | None = None
    saturation: Vector | None = None
    rate_limit: float | None = None
    gain: float = 1.0
    delay: float = 0.0
    history: float = 0.0
    actuator: TransferFunctionTable | None = None
    multiplicative: TransferFunctionTable | None = None


class NoiseTable(Table):
    """[sensor.noise]."""

    std: NumberOrVector
    sample_time: float
    seed: int = 0


class SensorTable(Table):
    """[sensor]."""

    lag: float = 0.0
    noise: NoiseTable | None = None


class UnmatchedTable(Table):
    """[[plant.unmatched]]."""

    direction: Vector
    signal: Signal


OneOrSeveralInputs = Annotated[
    Annotated[InputTable, Tag("one")] | Annotated[list[InputTable], Tag("several")],
    Discriminator(how_many),
]


class PolynomialTable(Table):
    """kind = "polynomial"."""

    kind: Literal["polynomial"]
    degree: int
    constant: bool = False


class GaussianTable(Table):
    """kind = "gaussian"."""

    kind: Literal["gaussian"]
    centers: Matrix
    width: float


class TermsTable(Table):
    """kind = "terms"."""

    kind: Literal["terms"]
    terms: list[str]


RegressorTable = Annotated[PolynomialTable | GaussianTable | TermsTable, Field(discriminator="kind")]


class PlantTable(Table):
    """[plant]."""

    A_m: Matrix | None = None
    A: Matrix | None = None
    b: VectorOrMatrix
    theta: VectorOrMatrix | None = None
    regressor: RegressorTable | None = None
    x0: Vector | None = None
    input: OneOrSeveralInputs | None = None
    disturbance: Signal | None = None
    unmatched: list[UnmatchedTable] = Field(default_factory=list)


class ReferenceModelTable(Table):
    """[reference_model]."""

    k_0: NumberOrMatrix
    A_m: Matrix | None = None
    poles: list[NumberOrVector] | None = None


class UncertaintyTable(Table):
    """[uncertainty]: a box (lower, upper) or a ball (center, radius); the intervals of unknown input gains."""

    lower: VectorOrMatrix | None = None
    upper: VectorOrMatrix | None = None
    center: VectorOrMatrix | None = None
    radius: float | None = None
    input_gain: VectorOrMatrix | None = None
