"""``fly``, and what can be flown: each flight says what it is, and how it is flown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from barbalat.protocols import Controller
from barbalat.run.progress import Progress
from barbalat.run.stepwise import Maker
from barbalat.validate import InputError, show
from barbalat.vehicles.compared import Compared
from barbalat.vehicles.drawing import Drawing
from barbalat.vehicles.f16 import comparison
from barbalat.vehicles.f16 import fleet as f16_fleet
from barbalat.vehicles.f16.airframe import FlightCondition
from barbalat.vehicles.f16.axis import AXES
from barbalat.vehicles.f16.equipment import Equipment
from barbalat.vehicles.f16.failures import FAILURES as F16_FAILURES
from barbalat.vehicles.quadrotor import comparison as quadrotor
from barbalat.vehicles.quadrotor import fleet as quadrotor_fleet
from barbalat.vehicles.quadrotor.failures import FAILURES as QUADROTOR_FAILURES
from barbalat.vehicles.request import Request


@dataclass(frozen=True, kw_only=True)
class FlightEntry:
    """One flight that can be flown.

    meaning   what flies, in words
    fly       flies it
    failures  the names of what can fail
    drawing   how a campaign draws its vehicles and flies them
    """

    meaning: str
    fly: Callable[[Request], Compared]
    failures: tuple[str, ...]
    drawing: Drawing


FLIGHTS = {
    **{
        name: FlightEntry(
            meaning=axis.meaning,
            fly=comparison.fly,
            failures=tuple(failure.name for failure in F16_FAILURES[name]),
            drawing=f16_fleet.drawing_of(name),
        )
        for name, axis in AXES.items()
    },
    "quadrotor": FlightEntry(
        meaning="a quadrotor flies a figure of eight in MuJoCo",
        fly=quadrotor.fly,
        failures=tuple(QUADROTOR_FAILURES),
        drawing=quadrotor_fleet.DRAWING,
    ),
}
"""By the names of the command line."""


def entry_of(name: str) -> FlightEntry:
    """InputError for a name that is none."""
    if name not in FLIGHTS:
        raise InputError(f"NAME must be one of {', '.join(FLIGHTS)}, got {show(name)}")
    return FLIGHTS[name]


def fly(
    name: str = "f16-pitch",
    *,
    schemes: Sequence[str] | None = None,
    controllers: Sequence[Controller] = (),
    failures: Sequence[str] | None = None,
    condition: FlightCondition | None = None,
    equipment: Equipment | None = None,
    delays: bool = False,
    software_in_the_loop: Maker | None = None,
    progress: Progress | None = None,
) -> Compared:
    """Fly controllers on a flight model, each through every failure; the extra ``flight`` has JSBSim and MuJoCo.

    name         "f16-pitch": JSBSim's F-16 follows a pitch-rate command; "f16-roll": a roll-rate command; "quadrotor": a figure
                 of eight in MuJoCo, by a geometric controller and what schemes add to it
    schemes      of ``flight.schemes.SCHEMES``, for the quadrotor of ``flight.quadrotor.schemes.SCHEMES``; all by default, "hinf"
                 where the extra ``robust`` is installed
    controllers  sampled ones of one's own beside them, bound to the ``adaptive_problem`` of the F-16's axis, or of the
                 quadrotor's roll, pitch and yaw
    failures     of ``flight.registry.FLIGHTS[name].failures``; all by default
    condition    where the F-16's level flight is trimmed; 10013 ft, Mach 0.525 by default
    equipment    what lies between controller and surface of the F-16; the axis's own by default
    delays       whether the delay is raised, too, until control is lost: some ten flights more for each controller
    software_in_the_loop  ``exported_c``: each controller flies as its exported C, compiled by this machine's compiler, beside
                 the simulated list, with which u and state are compared in every bit; by default that list flies alone

    Raises InputError for what can't be flown, SimulatorFailed where the simulator breaks before any flight.
    """
    entry = entry_of(name)
    if software_in_the_loop is not None and not callable(software_in_the_loop):
        raise InputError(
            f"software_in_the_loop must be what makes a controller fly, exported_c, got {show(software_in_the_loop)}"
        )
    request = Request(
        name=name,
        schemes=schemes,
        controllers=controllers,
        failures=failures,
        condition=condition,
        equipment=equipment,
        delays=delays,
        software_in_the_loop=software_in_the_loop,
        progress=progress,
    )
    return entry.fly(request)
