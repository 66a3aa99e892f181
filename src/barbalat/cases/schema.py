"""The case file's keys, as pydantic models: types and spelling are checked here, meaning in the objects' constructors."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from barbalat.cases.law_tables import LawTable, LearningTable, ModificationTable, NormalizationTable
from barbalat.cases.plant_tables import (
    GaussianTable,
    InputTable,
    NoiseTable,
    PlantTable,
    PolynomialTable,
    ReferenceModelTable,
    SensorTable,
    TermsTable,
    TransferFunctionTable,
    UncertaintyTable,
    UnmatchedTable,
)
from barbalat.cases.signal_tables import (
    ChirpSignal,
    ConstantSignal,
    CsvSignal,
    OneOrSeveralSignals,
    SineSignal,
    SinesSignal,
    SquareSignal,
    StepSignal,
    StepsSignal,
)
from barbalat.cases.tables import Gain, Table, Vector


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
    saturated_predictor: bool = False


class RobustMracTable(AdaptiveTable):
    """scheme = "robust-mrac"."""

    scheme: Literal["robust-mrac"]
    tau: float
    law: LawTable
    c_0: Vector | None = None
    normalization: NormalizationTable = NormalizationTable()
    saturated_predictor: bool = False


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
