"""The smallest vehicle: a boat whose yaw rate follows a command, integrated here. It loses half of its rudder."""

from dataclasses import dataclass

import numpy as np

from barbalat.controllers import KnownParameters, Sampled
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.plant import Plant, ReferenceModel
from barbalat.problem.regressors import Polynomial
from barbalat.problem.state_feedback import Problem
from barbalat.run.kernel.sampled_controller import SampledList
from barbalat.signals import Constant
from barbalat.sweeps.spread import Uniform
from barbalat.validate import InputError
from barbalat.vehicles.flight import Flight, Timing
from barbalat.vehicles.scene import attitudes
from barbalat.vehicles.schemes import OnLoop, Scheme, adrc, l1
from barbalat.vehicles.vehicle import DelaySearch, Drawing, Shown, Vehicle
from barbalat.vehicles.verdicts import Followed

SAMPLE, RATE, LARGEST = 0.05, 5.0, 30.0
"""Times [s]; the commanded yaw rate, and the yaw rate at which the boat capsizes [deg/s]."""


@dataclass(frozen=True, kw_only=True)
class Failure:
    name: str
    meaning: str
    rudder: float = 1.0
    delay: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Dispersion:
    drag: float = 1.0
    number: int = 0


class Loop:
    """The boat's motion x' = -x + u without a failure."""

    like, sample_time, time_unit, frequency_unit, known_gain, theta_hat0 = "yaw", SAMPLE, 1.0, 1.0, None, None
    met = np.array([1.0, RATE])

    def _problem(self, **plant):
        return Problem(
            plant=Plant(A_m=[[-1.0]], b=[1.0], input=PlantInput(saturation=(-40.0, 40.0)), **plant),
            reference_model=ReferenceModel(k_0=1.0),
            reference=Constant(RATE),
            uncertainty=ParameterBox(lower=-np.ones(2), upper=np.ones(2)) if "regressor" in plant else None,
        )

    @property
    def linear_problem(self):
        return self._problem(theta=[0.0])

    @property
    def adaptive_problem(self):
        return self._problem(theta=[0.0, 0.0], regressor=Polynomial(degree=1, constant=True))


COLUMNS = {"t": "s", "model": "deg/s", "rate": "deg/s", "rudder": "deg"}
UNITS = {"rms_e": "deg/s", "max_abs_e": "deg/s", "rudder_travel": "deg/s"}


class BoatFlight(Flight):
    columns, units = COLUMNS, UNITS

    @property
    def error(self):
        return self.column("rate") - self.column("model")

    @property
    def followed_by_judge(self):
        rate, model, rudder = (self.column(name)[:, None] for name in ("rate", "model", "rudder"))
        commands, limits = np.full_like(rate, RATE), np.array([[-40.0], [40.0]])
        return Followed(
            names=("rate",), units=("[deg/s]",), y=rate, y_m=model, u=rudder, limited=rudder, limits=limits, commands=commands
        )

    def measured(self, after):
        travel = np.abs(np.diff(self.column("rudder")[after])).sum() / (after.sum() * SAMPLE)
        return self.rms_error, np.abs(self.error[after]).max(), travel

    @property
    def path(self):
        heading = np.deg2rad(SAMPLE * np.cumsum(self.column("rate")))
        return SAMPLE * np.cumsum(np.column_stack([np.cos(heading), np.sin(heading), 0 * heading]), axis=0)

    @property
    def attitude(self):
        none = np.zeros(len(self.record))
        return attitudes(none, none, SAMPLE * np.cumsum(self.column("rate")))


def plain(loop, _):
    return OnLoop(loop.linear_problem, Sampled(KnownParameters(theta=[0.0], name="Plain"), SAMPLE, discretization="euler"))


def rate(flight):
    return flight.column("rate")


class Boat(Vehicle):
    simulator = "numpy"
    dispersion = Dispersion
    delays = DelaySearch(step=SAMPLE, stride=4, most=20)
    headings = ("RMS e", "max |e|", "rudder")
    length = "m"
    wire = (np.array([(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)]),)
    shown = "Yaw rate"
    notes = ("A boat that exists in a test alone",)
    columns, units = COLUMNS, UNITS
    panels = (Shown("Yaw rate", "[deg/s]", rate, (("model", "model", "ink", 1),)),)

    def require(self, condition, equipment):
        if condition is not None or equipment is not None:
            raise InputError("a boat has no altitude")

    def nominal(self, condition=None, equipment=None):
        return Loop()

    def loops(self, model):
        return (model,)

    def pilot(self, model, aboard):
        return aboard.loops[0].step()

    def fly(self, model, pilot, failures, dispersion, timing):
        return [self._fly_once(pilot, failure, dispersion, timing) for failure in failures]

    def _fly_once(self, pilot, failure, dispersion, timing):
        pilot.reset()
        x = x_m = 0.0
        record, late, lost = [], [0.0] * round(failure.delay / SAMPLE), ""
        for k in range(round(timing.duration / SAMPLE)):
            late.append(float(pilot(np.array([x]), RATE)[0]))
            u = late.pop(0) * (failure.rudder if k * SAMPLE >= timing.fails_at else 1.0)
            record.append((k * SAMPLE, x_m, x, u))
            if abs(x) > LARGEST:
                lost = "it capsized"
                break
            decay = np.exp(-dispersion.drag * SAMPLE)
            x = decay * x + (1 - decay) / dispersion.drag * u
            x_m = np.exp(-SAMPLE) * x_m + (1 - np.exp(-SAMPLE)) * RATE
        return BoatFlight(
            controller=pilot.name, failure=failure, record=np.array(record), lost=lost, timing=timing, agreement=pilot.agreement()
        )

    def delayed(self, seconds):
        return Failure(name="delay", meaning="", delay=seconds)

    def broken(self, controller, failure, why):
        return BoatFlight(controller=controller, failure=failure, record=np.zeros((1, 4)), lost=why, timing=self.timing)

    def contents(self, model, aboard):
        for one in aboard:
            yield repr([(each.name, each.program) for each in one.loops if isinstance(each, SampledList)]).encode()

    def headline(self, model):
        return "boat: RMS error of the yaw rate"

    def cells(self, figures):
        return [f"{figures[name]:.2f}" for name in self.units]

    def facts(self, model, version):
        return [("computed", f"NumPy {version}")]

    def details(self, model, version):
        return {"simulation": {"simulator": f"NumPy {version}"}}


TIMING = Timing(duration=10.0, fails_at=5.0)
RANGE = {"bandwidth": (0.1, 10.0)}
VEHICLES = (
    Boat(
        name="boat",
        meaning="a boat follows a yaw-rate command",
        failures=(Failure(name="none", meaning="nothing fails"), Failure(name="rudder-50", meaning="half a rudder", rudder=0.5)),
        schemes={
            "plain": Scheme(plain, {}, counterpart="lqr"),
            "adrc": Scheme(adrc, RANGE),
            "l1": Scheme(l1, RANGE | {"adaptation": (0.1, 10.0)}),
        },
        numbers={"yaw": {"plain": {}, "adrc": {"bandwidth": 5.0}, "l1": {"bandwidth": 5.0, "adaptation": 5.0}}},
        timing=TIMING,
        drawing=Drawing(
            drawn={"drag": Uniform(0.8, 1.2)},
            units={},
            conditions={"in calm water": None},
            timing=TIMING,
            travel=("rudder_travel", "rudder"),
            beside=("Plain", "plain"),
            set_by="hand",
            chunk=100,
        ),
    ),
)
