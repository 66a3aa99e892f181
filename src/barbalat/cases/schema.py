"""The case file's keys, as pydantic models: types and spelling are checked here, meaning in the objects' constructors."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AliasChoices, Discriminator, Field, Tag

from barbalat.cases.law_tables import LawTable, LearningTable, ModificationTable, NormalizationTable
from barbalat.cases.tables import Gain, Matrix, NumberOrMatrix, NumberOrVector, Table, Vector, VectorOrMatrix, how_many


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
    """[uncertainty]: a box (lower, upper) or a ball (center, radius)."""

    lower: VectorOrMatrix | None = None
    upper: VectorOrMatrix | None = None
    center: VectorOrMatrix | None = None
    radius: float | None = None
    input_gain: Vector | None = None


class SimulationTable(Table):
    """[simulation]."""

    t_end: float
    dt: float
    solver: str = "rk4"
    record_points: int = 2000


class FilterTable(Table):
    """filter = { kappa = ... } or { num = [...], den = [...] }."""

    kappa: float | None = None
    num: Vector | None = None
    den: Vector | None = None


class SchemeTable(Table):
    """What all schemes have in common."""

    name: str | None = Field(default=None, min_length=1)
    sample_time: float | None = None
    discretization: Literal["midpoint", "euler"] | None = None


class AdaptiveTable(SchemeTable):
    """What all adaptive schemes have in common."""

    projection: bool | None = None
    theta_hat0: Vector | None = None

    def common(self) -> dict[str, Any]:
        """The settings that were given."""
        given = {"name": self.name, "projection": self.projection, "theta_hat0": self.theta_hat0}
        return {key: value for key, value in given.items() if value is not None}


class ModifiedErrorTable(Table):
    """modified_error = { mu = ..., margin = ... }."""

    mu: float = 0.0
    margin: float = 0.0


class MracTable(AdaptiveTable):
    """scheme = "mrac"."""

    scheme: Literal["mrac"]
    gamma: Gain
    modified_error: ModifiedErrorTable | None = None
    modification: ModificationTable | None = None
    learning: LearningTable | None = None


class L1Table(AdaptiveTable):
    """scheme = "l1"."""

    scheme: Literal["l1"]
    gamma: Gain
    saturated_predictor: bool = False
    filter: FilterTable
    modification: ModificationTable | None = None
    learning: LearningTable | None = None


class NormalizedMracTable(AdaptiveTable):
    """scheme = "mrac-normalized"; gamma alone means the gradient law."""

    scheme: Literal["mrac-normalized"]
    gamma: Gain | None = None
    law: LawTable | None = None
    c_0: Vector | None = None
    normalization: NormalizationTable = NormalizationTable()


class RobustMracTable(AdaptiveTable):
    """scheme = "robust-mrac"."""

    scheme: Literal["robust-mrac"]
    tau: float
    law: LawTable
    c_0: Vector | None = None
    normalization: NormalizationTable = NormalizationTable()
    printed_sign: bool = False


class LinearTable(SchemeTable):
    """scheme = "linear": a transfer function, or a design."""

    scheme: Literal["linear"]
    controller: TransferFunctionTable | None = None
    design: Literal["hinf", "pi"] | None = None
    unmodelled_delay: float | None = None
    bandwidth: float | None = None
    output: Vector | None = None
    nominal: Vector | None = None


ControllerTable = Annotated[
    MracTable | L1Table | NormalizedMracTable | RobustMracTable | LinearTable,
    Field(discriminator="scheme"),
]


class CaseTable(Table):
    """A whole case file."""

    name: str
    plant: PlantTable
    reference_model: ReferenceModelTable
    reference: OneOrSeveralSignals
    uncertainty: UncertaintyTable | None = None
    sensor: SensorTable | None = None
    simulation: SimulationTable
    controller: list[ControllerTable] = Field(min_length=1)


TABLES: dict[str | None, type[Table]] = {
    None: CaseTable,
    "plant": PlantTable,
    "input": InputTable,
    "actuator": TransferFunctionTable,
    "multiplicative": TransferFunctionTable,
    "unmatched": UnmatchedTable,
    "polynomial": PolynomialTable,
    "gaussian": GaussianTable,
    "terms": TermsTable,
    "sensor": SensorTable,
    "noise": NoiseTable,
    "reference_model": ReferenceModelTable,
    "uncertainty": UncertaintyTable,
    "simulation": SimulationTable,
    "filter": FilterTable,
    "modified_error": ModifiedErrorTable,
    "law": LawTable,
    "modification": ModificationTable,
    "learning": LearningTable,
    "normalization": NormalizationTable,
    "constant": ConstantSignal,
    "step": StepSignal,
    "steps": StepsSignal,
    "sine": SineSignal,
    "sines": SinesSignal,
    "square": SquareSignal,
    "chirp": ChirpSignal,
    "csv": CsvSignal,
    "mrac": MracTable,
    "l1": L1Table,
    "mrac-normalized": NormalizedMracTable,
    "robust-mrac": RobustMracTable,
    "linear": LinearTable,
}
"""Every table by the last name in its place: its key, or the kind or scheme that chose it."""
