"""Schemes on the quadrotor, side by side: how they are flown, what is said and shown of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from typing import TYPE_CHECKING, Any

import numpy as np

from barbalat.protocols import Controller
from barbalat.run.sampled_step import SampledList
from barbalat.run.stepwise import Flyable, Maker
from barbalat.validate import InputError, require_extra, show
from barbalat.vehicles.compared import Compared, Failing
from barbalat.vehicles.isolated import SECONDS_PER_FLIGHT, STARTING_SECONDS, SimulatorFailed, isolated
from barbalat.vehicles.quadrotor.axes import ATTITUDE_SAMPLE, POSITION_SAMPLE, Axes
from barbalat.vehicles.quadrotor.control import Scheme
from barbalat.vehicles.quadrotor.failures import FAILURES, Failure
from barbalat.vehicles.quadrotor.flight import COLUMNS, FIGURES, TIMING, QuadrotorFlight
from barbalat.vehicles.quadrotor.flying import DELAY_STEP, MOST_DELAY_STEPS, delay_borne, flown
from barbalat.vehicles.quadrotor.hover import hovering
from barbalat.vehicles.quadrotor.schemes import OnAxis, available, on_axis, require_known
from barbalat.vehicles.quadrotor.trajectory import TAKES_OFF
from barbalat.vehicles.quadrotor.vehicle import AIR_DENSITY, INTEGRATOR, PLACES, SLOPE, STEP, Quadrotor
from barbalat.vehicles.request import Request
from barbalat.vehicles.scene import Mover, Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AROUND = np.linspace(0, 2 * np.pi, 13)
WIRE = (
    *(np.array([(x, y, 0.0), (-x, -y, 0.0)]) for x, y in PLACES[:2]),
    *(np.column_stack([x + 0.6 * np.cos(AROUND), y + 0.6 * np.sin(AROUND), 0 * AROUND]) for x, y in PLACES),
    np.array([(0.0, 0.0, 0.0), (1.6, 0.0, 0.0)]),
)
"""Two arms, four rotors, and a mark that points forward."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class QuadrotorComparison(Compared):
    """All flights of some schemes through some failures.

    mujoco    its version
    axes      the vehicle's, with their linear model and gains
    flights   for each scheme those through all failures, in their order
    delays    the largest added delay with which each kept the vehicle [s], by name; None where nobody asked
    exported  whether the exported C flew
    """

    name: str
    axes: Axes
    failures: tuple[Failure, ...]
    mujoco: str
    flights: tuple[tuple[QuadrotorFlight, ...], ...]
    delays: dict[str, float] | None = None
    exported: bool = False

    @property
    def headline(self) -> str:
        return f"{self.name}: RMS distance [m] from where it should be after each failure"

    @property
    def columns(self) -> dict[str, str]:
        return COLUMNS

    @property
    def units(self) -> dict[str, str]:
        return FIGURES

    @property
    def headings(self) -> tuple[str, ...]:
        return ("RMS e\n[m]", "max e\n[m]", "sinks\n[m]", "tilt\n[deg]", "rotors\n[N/s]", "limited\n[%]")

    def cells(self, figures: dict[str, float | None]) -> list[str]:
        digits = {"rms_e": 3, "max_abs_e": 3, "sinks": 3, "tilt_max": 1, "rotor_travel": 2, "limited": 1}
        return ["-" if figures[name] is None else f"{figures[name]:.{count}f}" for name, count in digits.items()]

    @property
    def notes(self) -> tuple[str, ...]:
        return (
            f"From the failure on, which comes at {TIMING.fails_at:g} s and stays (no-reset: from the start at {TAKES_OFF:g} s); "
            "e is the distance from where it should be, sinks how far it came below that, tilt its largest value, rotors how "
            "much a thrust changes in a second, limited the share of the time in which some rotor is at an end of its range",
            "each of the project's schemes has on each axis the setting that one rule gives on the linearised vehicle, and "
            "none is tuned on flights: these are ranked",
        )

    def facts(self) -> list[tuple[str, str]]:
        hover, roll, forward = self.axes.hover, self.axes.attitude[0], self.axes.position[0]
        return [
            ("hover", f"{hover.vehicle.mass:g} kg, {hover.thrusts[0]:.3f} N of {hover.vehicle.thrust:g} N on each rotor"),
            (
                "loops",
                f"roll and pitch {roll.frequency:.2f} rad/s for a lag of {1e3 * roll.lag:.0f} ms, position "
                f"{forward.frequency:.2f} rad/s for {1e3 * forward.lag:.0f} ms",
            ),
            (
                "computed",
                f"MuJoCo {self.mujoco}, {INTEGRATOR}, {1 / STEP:g} Hz; control at {1 / ATTITUDE_SAMPLE:g} Hz "
                f"and {1 / POSITION_SAMPLE:g} Hz, {TIMING.duration:g} s",
            ),
        ]

    def details(self) -> dict[str, Any]:
        hover = self.axes.hover
        return {
            "vehicle": {name: np.asarray(value).tolist() for name, value in asdict(hover.vehicle).items()},
            "hover": {"thrusts_N": hover.thrusts.tolist(), "A": hover.A.tolist(), "B": hover.B.tolist()},
            "design": {
                axis.name: {
                    "gain": axis.gain.tolist(), "frequency": axis.frequency, "lag": axis.lag, "limit": axis.limit,
                    "sample_time": axis.sample_time,
                }
                for axis in (*self.axes.attitude, *self.axes.position)
            },
            "electronics": asdict(self.axes.electronics),
            "simulation": {
                "simulator": f"MuJoCo {self.mujoco}", "integrator": INTEGRATOR, "dt": STEP, "air_density": AIR_DENSITY,
                "slope_deg": SLOPE, "t_end": TIMING.duration, "fails_at": TIMING.fails_at, "takes_off": TAKES_OFF,
            },
        }  # fmt: skip

    @property
    def longest_delay(self) -> float:
        return MOST_DELAY_STEPS * DELAY_STEP

    @property
    def shown(self) -> str:
        return "Distance from where it should be, height, tilt and thrust of one rotor of every controller"

    def figure(self, failure: Failing, *, narrow: bool = False, shown: bool = False) -> Figure:
        from barbalat.vehicles.quadrotor.picture import figure_of

        return figure_of(self._through(failure), narrow=narrow, shown=shown)

    def scene(self, failure: Failing, controllers: Sequence[str]) -> Scene | None:
        chosen = [
            (i, one) for i, one in enumerate(self._through(failure)) if one.controller in controllers and len(one.record) > 1
        ]
        if not chosen:
            return None
        longest = max((one for _, one in chosen), key=lambda one: len(one.record))
        movers = [
            Mover(label=one.controller, colour=i, path=one.record[:, 4:7], attitude=one.attitude, lost=bool(one.lost))
            for i, one in chosen
        ]
        return Scene(
            title=failure.meaning, unit="m", t=longest.column("t"), target=longest.record[:, 1:4], movers=tuple(movers),
            wire=WIRE, fails=longest.since, failing=failure != FAILURES["none"],
        )  # fmt: skip

    def _through(self, failure: Failing) -> list[QuadrotorFlight]:
        return [flight for several in self.flights for flight in several if flight.failure == failure]


def fly(request: Request) -> QuadrotorComparison:
    """The schemes on all axes; controllers of one's own on roll, pitch and yaw, bound to each one's ``adaptive_problem``."""
    wanted = available() if request.schemes is None else list(request.schemes)
    require_known(wanted)
    chosen = chosen_failures(request.failures)
    if request.condition is not None or request.equipment is not None:
        raise InputError("condition and equipment, --altitude and --mach, are the F-16's: the quadrotor hovers near the ground")
    axes, maker = nominal_axes(), request.software_in_the_loop
    schemes = _schemes(axes, wanted, request.controllers)
    _require_different([one.name for one in schemes])
    flying = schemes if maker is None else _schemes(axes, wanted, request.controllers, maker)
    flights, borne = [], {}
    for i, (scheme, flies) in enumerate(zip(schemes, flying, strict=True)):
        flights.append(tuple(_flown(axes, flies, chosen)))
        if request.delays:
            borne[scheme.name] = isolated(STARTING_SECONDS + 20 * SECONDS_PER_FLIGHT, delay_borne, axes, scheme)
        if request.progress is not None:
            request.progress((i + 1) / len(schemes))
    return QuadrotorComparison(
        name=request.name,
        axes=axes,
        failures=chosen,
        mujoco=metadata.version("mujoco"),
        flights=tuple(flights),
        delays=borne if request.delays else None,
        exported=maker is not None,
    )


def nominal_axes() -> Axes:
    """Of the vehicle that the controllers are designed for; hover is found in a process of its own."""
    require_extra("mujoco", "flight", "the quadrotor")
    return Axes(hover=isolated(STARTING_SECONDS, hovering, Quadrotor()))


def chosen_failures(names: Sequence[str] | None) -> tuple[Failure, ...]:
    """All by default; InputError for what is none."""
    unknown = [one for one in names or () if one not in FAILURES]
    if unknown:
        raise InputError(f"--failure must be of {', '.join(FAILURES)}, got {show(unknown[0])}")
    return tuple(FAILURES[one] for one in dict.fromkeys(names or FAILURES))


def _schemes(axes: Axes, names: Sequence[str], controllers: Sequence[Controller], maker: Maker = SampledList.of) -> list[Scheme]:
    return [
        *(scheme_on(axes, name, maker) for name in dict.fromkeys(names)),
        *(_own(one, axes, maker) for one in controllers),
    ]


def scheme_on(axes: Axes, name: str, maker: Maker = SampledList.of) -> Scheme:
    """A scheme on all six, as what flies."""

    def on(several: Sequence[OnAxis]) -> tuple[Flyable, ...]:
        return tuple(maker(*one) for one in several)

    attitude, position = ([on_axis(name, axis) for axis in several] for several in (axes.attitude, axes.position))
    return Scheme(name=attitude[0].controller.name, attitude=on(attitude), position=on(position))


def _own(controller: Controller, axes: Axes, maker: Maker) -> Scheme:
    """What is somebody's own turns the vehicle; its place is left to the geometric controller."""
    lists = [maker(axis.adaptive_problem, controller) for axis in axes.attitude]
    if lists[0].sample_time != ATTITUDE_SAMPLE:
        raise InputError(
            f"{controller.name} must have sample_time {ATTITUDE_SAMPLE:g} s, that of the attitude's computer, "
            f"got {lists[0].sample_time:g}"
        )
    alone = scheme_on(axes, "geometric", maker)
    return Scheme(name=controller.name, attitude=tuple(lists), position=alone.position)


def _flown(axes: Axes, scheme: Scheme, failures: Sequence[Failure]) -> list[QuadrotorFlight]:
    """All in one process; where that breaks, each in its own, so that only what breaks is lost."""
    try:
        return isolated(STARTING_SECONDS + SECONDS_PER_FLIGHT * len(failures), flown, axes, scheme, failures)
    except SimulatorFailed as error:
        if len(failures) == 1:
            record = np.zeros((1, len(COLUMNS)))
            return [QuadrotorFlight(controller=scheme.name, failure=failures[0], record=record, lost=str(error))]
        return [flight for failure in failures for flight in _flown(axes, scheme, [failure])]


def _require_different(names: Sequence[str]) -> None:
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"controllers must have different names, got {show(twice[0])} twice")
