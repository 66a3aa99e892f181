"""The quadrotor as a vehicle that flies a figure of eight in MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from barbalat.run.kernel.sampled_controller import SampledList
from barbalat.validate import Array, InputError, require_extra
from barbalat.vehicles.flight import Timing
from barbalat.vehicles.isolated import STARTING_SECONDS, isolated
from barbalat.vehicles.quadrotor.axes import ATTITUDE_SAMPLE, POSITION_SAMPLE, Axes, Axis
from barbalat.vehicles.quadrotor.body import AIR_DENSITY, INTEGRATOR, PLACES, SLOPE, STEP, Quadrotor
from barbalat.vehicles.quadrotor.control import Control
from barbalat.vehicles.quadrotor.dispersions import DRAWN, UNITS, Dispersion
from barbalat.vehicles.quadrotor.failures import FAILURES, Failure
from barbalat.vehicles.quadrotor.flight import COLUMNS, FIGURES, TIMING, QuadrotorFlight
from barbalat.vehicles.quadrotor.flying import fly_all
from barbalat.vehicles.quadrotor.hover import hovering
from barbalat.vehicles.quadrotor.schemes import SCHEMES, TUNED
from barbalat.vehicles.quadrotor.trajectory import TAKES_OFF
from barbalat.vehicles.vehicle import Aboard, DelaySearch, Drawing, Shown, Vehicle

AROUND = np.linspace(0, 2 * np.pi, 13)
WIRE = (
    *(np.array([(x, y, 0.0), (-x, -y, 0.0)]) for x, y in PLACES[:2]),
    *(np.column_stack([x + 0.6 * np.cos(AROUND), y + 0.6 * np.sin(AROUND), 0 * AROUND]) for x, y in PLACES),
    np.array([(0.0, 0.0, 0.0), (1.6, 0.0, 0.0)]),
)
"""The frame: two arms, four rotors, and a mark that points forward."""


CAMPAIGN_TIMING = Timing(duration=13.0, fails_at=8.0)
"""The failure occurs when the figure of eight has reached its speed. Most of an eight follows."""


def _height(flight: QuadrotorFlight) -> Array:
    return flight.column("z")


def _thrust(flight: QuadrotorFlight) -> Array:
    return flight.column("thrust_1")


@dataclass(frozen=True, eq=False, kw_only=True)
class FigureOfEight(Vehicle[Axes, Control, QuadrotorFlight]):
    """The quadrotor. Schemes act on all six axes, controllers of a user on roll, pitch and yaw."""

    simulator = "mujoco"
    dispersion = Dispersion
    delays = DelaySearch(step=ATTITUDE_SAMPLE, stride=8, most=64)
    own_loops = 3
    own_rest = "geometric"
    headings = ("RMS e\n[m]", "max e\n[m]", "sinks\n[m]", "tilt\n[deg]", "rotors\n[N/s]", "limited\n[%]")
    length = "m"
    wire = WIRE
    shown = "Distance from the commanded position, height, tilt and thrust of one rotor of every controller"
    panels = (
        Shown("Distance from the commanded position", "[m]", lambda flight: flight.error),
        Shown("Height above the ground", "[m]", _height, (("z_d", "commanded", "ink", 1),)),
        Shown("Tilt", "[deg]", lambda flight: flight.tilt),
        Shown("Thrust of the front left rotor", "[N]", _thrust),
    )
    columns = COLUMNS
    units = FIGURES
    notes = (
        f"all numbers refer to the time after the failure, which occurs at {TIMING.fails_at:g} s and persists (no-reset: after "
        f"the start at {TAKES_OFF:g} s). e is the distance from the commanded position, and sinks the largest distance below it; "
        f"rotors is the average change of a thrust per second. limited is the fraction of the time with some rotor at an "
        f"end of its range",
        "the project's schemes are tuned by one rule, axis by axis, on the linearised vehicle and not on flights; only these "
        "schemes are ranked",
    )

    def require(self, condition: object, equipment: object) -> None:
        if condition is not None or equipment is not None:
            raise InputError(
                "condition and equipment, --altitude and --mach, apply only to the F-16: the quadrotor hovers near the ground"
            )

    def nominal(self, condition: object = None, equipment: object = None) -> Axes:
        """Return the vehicle for which the controllers are designed."""
        require_extra("mujoco", "flight", "the quadrotor")
        return Axes(hover=isolated(STARTING_SECONDS, hovering, Quadrotor()))

    def loops(self, model: Axes) -> tuple[Axis, ...]:
        return model.all

    def pilot(self, model: Axes, aboard: Aboard) -> Control:
        return Control(model, aboard)

    def fly(
        self, model: Axes, pilot: Control, failures: Sequence[Failure], dispersion: Dispersion, timing: Timing
    ) -> list[QuadrotorFlight]:
        return fly_all(model, pilot, failures, dispersion, timing)

    def delayed(self, seconds: float) -> Failure:
        return Failure(name="delay", meaning="", delay=seconds)

    def broken(self, controller: str, failure: Failure, why: str) -> QuadrotorFlight:
        return QuadrotorFlight(controller=controller, failure=failure, record=np.zeros((1, len(COLUMNS))), lost=why)

    def contents(self, model: Axes, aboard: Sequence[Aboard]) -> Iterator[bytes]:
        for scheme in aboard:
            lists = [one for one in scheme.loops if isinstance(one, SampledList)]
            yield repr((scheme.name, [(one.program, one.initial.tolist()) for one in lists])).encode()
        yield model.hover.A.tobytes() + model.hover.B.tobytes()
        yield repr([one.gain.tolist() for one in model.all]).encode()

    def headline(self, model: Axes) -> str:
        return f"{self.name}: RMS distance [m] from the commanded position after each failure"

    def cells(self, figures: Mapping[str, float | None]) -> list[str]:
        digits = {"rms_e": 3, "max_abs_e": 3, "sinks": 3, "tilt_max": 1, "rotor_travel": 2, "limited": 1}
        return ["-" if figures[name] is None else f"{figures[name]:.{count}f}" for name, count in digits.items()]

    def facts(self, model: Axes, version: str) -> list[tuple[str, str]]:
        hover, roll, forward = model.hover, model.attitude[0], model.position[0]
        return [
            ("hover", f"{hover.vehicle.mass:g} kg, {hover.thrusts[0]:.3f} N of {hover.vehicle.thrust:g} N on each rotor"),
            (
                "loops",
                f"roll and pitch {roll.frequency:.2f} rad/s for a lag of {1e3 * roll.lag:.0f} ms, position "
                f"{forward.frequency:.2f} rad/s for {1e3 * forward.lag:.0f} ms",
            ),
            (
                "computed",
                f"MuJoCo {version}, {INTEGRATOR}, {1 / STEP:g} Hz; control at {1 / ATTITUDE_SAMPLE:g} Hz "
                f"and {1 / POSITION_SAMPLE:g} Hz, {TIMING.duration:g} s",
            ),
        ]

    def details(self, model: Axes, version: str) -> dict[str, Any]:
        hover = model.hover
        return {
            "vehicle": {name: np.asarray(value).tolist() for name, value in asdict(hover.vehicle).items()},
            "hover": {"thrusts_N": hover.thrusts.tolist(), "A": hover.A.tolist(), "B": hover.B.tolist()},
            "design": {
                axis.name: {
                    "gain": axis.gain.tolist(), "frequency": axis.frequency, "lag": axis.lag, "limit": axis.limit,
                    "sample_time": axis.sample_time,
                }
                for axis in (*model.attitude, *model.position)
            },
            "electronics": asdict(model.electronics),
            "simulation": {
                "simulator": f"MuJoCo {version}", "integrator": INTEGRATOR, "dt": STEP, "air_density": AIR_DENSITY,
                "slope_deg": SLOPE, "t_end": TIMING.duration, "fails_at": TIMING.fails_at, "takes_off": TAKES_OFF,
            },
        }  # fmt: skip


VEHICLES = (
    FigureOfEight(
        name="quadrotor",
        meaning="a quadrotor flies a figure of eight in MuJoCo",
        failures=tuple(FAILURES.values()),
        schemes=SCHEMES,
        numbers=TUNED,
        timing=TIMING,
        drawing=Drawing(
            drawn=DRAWN,
            units=UNITS,
            conditions={"near the ground": None},
            timing=CAMPAIGN_TIMING,
            travel=("rotor_travel", "rotors"),
            beside=("Geometric, integral", "integral"),
            set_by="one rule for all (benchmarks/flight_tuning.py): on each linearised axis, the smallest RMS error "
            "with a gain margin of 1.5 and half of the delay margin of the feedback alone",
            chunk=56,
        ),
    ),
)
