"""The case file's keys for output feedback: what differs from the tables of ``schema``."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from barbalat.adaptation.law import AdaptiveLaw
from barbalat.adaptation.output_lyapunov import LyapunovLaw
from barbalat.cases.law_tables import LawTable, ModificationTable, NormalizationTable
from barbalat.cases.plant_tables import InputTable, SensorTable, TransferFunctionTable
from barbalat.cases.schema import SchemeTable, SimulationTable
from barbalat.cases.signal_tables import Signal
from barbalat.cases.tables import Gain, Table, Vector


class OutputPlantTable(Table):
    """[plant] with transfer_function."""

    transfer_function: TransferFunctionTable
    nonlinear: str | None = None
    input: InputTable | None = None
    disturbance: Signal | None = None
    output_disturbance: Signal | None = None


class OutputModelTable(Table):
    """[reference_model] with transfer_function."""

    transfer_function: TransferFunctionTable


class LyapunovLawTable(ModificationTable):
    """law = { kind = "lyapunov", ... }."""

    kind: Literal["lyapunov"]
    gamma: Gain

    def build(self) -> LyapunovLaw:
        return LyapunovLaw(gamma=self.gamma, leakage=self.leakage(), dead_zone=self.dead_zone())


class MracOutputTable(SchemeTable):
    """scheme = "mrac-output"."""

    scheme: Literal["mrac-output"]
    order: int
    relative_degree: int
    sign: int
    law: Annotated[LyapunovLawTable | LawTable, Field(discriminator="kind")]
    theta_hat0: Vector | None = None
    tau: float | None = None
    filter_poles: Vector | None = None
    lower: Vector | None = None
    upper: Vector | None = None
    c_0_min: float | None = None
    projection: bool | None = None
    normalization: NormalizationTable = NormalizationTable()
    saturated_predictor: bool = False

    def built_law(self) -> AdaptiveLaw | LyapunovLaw:
        return self.law.build()


class L1OutputTable(SchemeTable):
    """scheme = "l1-output"."""

    scheme: Literal["l1-output"]
    m: float
    gamma: float
    filter: TransferFunctionTable
    sigma_bound: float | None = None
    projection: bool | None = None
    lipschitz: float | None = None
    design_plant: TransferFunctionTable | None = None


class LinearOutputTable(SchemeTable):
    """scheme = "linear": u = K[y_m - y], or u = F[r] - K[y] with feedforward; or what an l1-output controller is."""

    scheme: Literal["linear"]
    equivalent_of: str | None = None
    limit: bool = False
    controller: TransferFunctionTable | None = None
    feedforward: TransferFunctionTable | None = None
    design: Literal["hinf", "pi"] | None = None
    design_plant: TransferFunctionTable | None = None
    unmodelled_delay: float | None = None
    bandwidth: float | None = None


OutputSchemeTable: TypeAlias = MracOutputTable | L1OutputTable | LinearOutputTable


class OutputCaseTable(Table):
    """A whole case file whose plant is a transfer function."""

    name: str
    plant: OutputPlantTable
    reference_model: OutputModelTable
    reference: Signal
    sensor: SensorTable | None = None
    simulation: SimulationTable
    controller: list[Annotated[OutputSchemeTable, Field(discriminator="scheme")]] = Field(min_length=1)


TABLES: dict[str | None, type[Table]] = {
    None: OutputCaseTable,
    "plant": OutputPlantTable,
    "reference_model": OutputModelTable,
    "lyapunov": LyapunovLawTable,
    "mrac-output": MracOutputTable,
    "l1-output": L1OutputTable,
    "linear": LinearOutputTable,
    "transfer_function": TransferFunctionTable,
    "controller": TransferFunctionTable,
    "feedforward": TransferFunctionTable,
    "design_plant": TransferFunctionTable,
    "filter": TransferFunctionTable,
}
"""Every table by the last name in its place, where it is not as in ``schema``."""
