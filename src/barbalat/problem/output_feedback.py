"""The output-feedback tracking problem: a SISO plant and a model given by transfer functions; only y is measured."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field
from typing import ClassVar

from barbalat import validate
from barbalat.linear.systems import TransferFunction
from barbalat.problem.labels import Labels
from barbalat.problem.measurement import Sensor
from barbalat.problem.output_plant import OutputDynamics, OutputPlant, OutputReferenceModel
from barbalat.problem.tracking import TrackingProblem, require_signal
from barbalat.protocols import Signal
from barbalat.settings import Settings
from barbalat.signals import Constant
from barbalat.validate import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class OutputKnown:
    """What a designer has: the reference model. The plant stands here only to refuse assumptions that it contradicts."""

    W_m: TransferFunction
    plant: TransferFunction
    saturation: Array | None = None  # (2,) lower and upper limit of the actuator; None where it has none


@dataclass(frozen=True, eq=False, repr=False)
class OutputProblem(TrackingProblem, Settings):
    """Plant, model, command r(t), input disturbance d(t), output disturbance, and how y is measured.

    plant, reference_model  by their transfer functions
    reference               the command r(t)
    disturbance             enters with u; none by default
    output_disturbance      added to the output; none by default
    sensor                  how y is measured; exactly by default
    labels                  name and unit of the output, unit of the input, for pictures; none by default

    What ``output_disturbance`` adds to G's output belongs to y: it is in e = y - y_m and in what is measured, not in f(t, y).
    """

    plant: OutputPlant
    reference_model: OutputReferenceModel
    reference: Signal = field(default_factory=Constant)
    _: KW_ONLY
    disturbance: Signal | None = None
    output_disturbance: Signal | None = None
    sensor: Sensor | None = None
    labels: Labels | None = None
    name: str = "problem"

    feedback: ClassVar[str] = "output"
    uncertainty: ClassVar[None] = None
    """The known set is the controller's: it depends on the parametrisation."""

    def __post_init__(self) -> None:
        validate.line("name", self.name)
        validate.instance("plant", self.plant, OutputPlant)
        validate.instance("reference_model", self.reference_model, OutputReferenceModel)
        require_signal("reference", self.reference)
        for name in ("disturbance", "output_disturbance"):
            if getattr(self, name) is not None:
                require_signal(name, getattr(self, name))
        if self.labels is not None:
            validate.instance("labels", self.labels, Labels)
            self.labels.require(1, 1)
        if self.sensor is not None:
            validate.instance("sensor", self.sensor, Sensor)
            if self.sensor.noise is not None:
                validate.vector("sensor.noise.std", self.sensor.noise.std, 1)

    @property
    def in_brief(self) -> str:
        order, of_model = (len(system.den) - 1 for system in (self.known.plant, self.known.W_m))
        return f"output feedback, a plant of order {order}, a model of order {of_model}"

    @property
    def dynamics(self) -> OutputDynamics:
        return self.plant.dynamics

    @property
    def model(self) -> OutputDynamics:
        return self.reference_model.dynamics

    @property
    def depends_on_time(self) -> bool:
        f = self.plant.f
        return f is not None and f.depends_on_time

    @property
    def known(self) -> OutputKnown:
        return OutputKnown(
            W_m=self.reference_model.transfer_function,
            plant=self.plant.transfer_function,
            saturation=self.plant.paths[0].saturation,
        )
