"""JSBSim's F-16 as two vehicles, one for a pitch-rate and one for a roll-rate command in level flight."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from barbalat.run.kernel.sampled_controller import SampledList, Step
from barbalat.validate import Array, require_extra
from barbalat.vehicles.f16.airframe import CONDITIONS, INTEGRATOR, STEP, FlightCondition
from barbalat.vehicles.f16.axis import AXES, SAMPLE_TIME, Axis, Followed
from barbalat.vehicles.f16.dispersions import DRAWN, UNITS, Dispersion
from barbalat.vehicles.f16.equipment import Equipment
from barbalat.vehicles.f16.failures import FAILS_AT, FAILURES, Failure
from barbalat.vehicles.f16.flight import TIMING, AxisFlight, columns_of, figures_of
from barbalat.vehicles.f16.flying import fly_once
from barbalat.vehicles.f16.schemes import SCHEMES, TUNED
from barbalat.vehicles.f16.trim import trimmed
from barbalat.vehicles.flight import Timing
from barbalat.vehicles.isolated import STARTING_SECONDS, isolated
from barbalat.vehicles.vehicle import Aboard, DelaySearch, Drawing, Shown, Vehicle

WIRE = tuple(
    np.array(line, dtype=float)
    for line in (
        [(1.5, 0, 0), (-1.2, 0, 0)],
        [(0.3, 0, 0), (-0.7, 1, 0), (-0.9, 0, 0), (-0.7, -1, 0), (0.3, 0, 0)],
        [(-0.8, 0, 0), (-1.3, 0, 0.6), (-1.2, 0, 0)],
    )
)
"""The frame: a fuselage, a wing and a fin, with the axes forward, left and up."""


CAMPAIGN_TIMING = Timing(duration=15.0, fails_at=5.0)
"""The failure occurs when the first command is reversed. A further command follows."""
RATES = {"p": "Roll rate", "q": "Pitch rate"}


@dataclass(frozen=True, eq=False, kw_only=True)
class F16(Vehicle[Axis, Step, AxisFlight]):
    """One axis of the F-16. ``followed`` defines the rate that follows a command, and the control surface."""

    followed: Followed

    simulator = "jsbsim"
    dispersion = Dispersion
    delays = DelaySearch(step=SAMPLE_TIME, stride=5, most=50)
    headings = ("RMS e\n[deg/s]", "max |e|\n[deg/s]", "n_z\n[g]", "alpha\n[deg]", "surface\n[deg/s]")
    length = "ft"
    equal_lengths = False
    wire = WIRE
    shown = "Controlled rate, angles, load factor and surface of every controller"
    notes = (
        f"all numbers refer to the time after the failure, which occurs at {FAILS_AT:g} s and persists. e is the controlled rate "
        f"minus that of the reference model, alpha the largest angle of attack, and surface the travel of the surface per second",
        "the project's schemes are tuned by one rule on the linearised aircraft and not on flights; only these schemes are "
        "ranked",
    )

    def condition(self, given: Mapping[str, float]) -> FlightCondition:
        return FlightCondition(**given)

    def require(self, condition: FlightCondition | None, equipment: Equipment | None) -> None:
        """It takes both."""

    def nominal(self, condition: FlightCondition | None = None, equipment: Equipment | None = None) -> Axis:
        require_extra("jsbsim", "flight", "a flight model")
        followed = self.followed if equipment is None else replace(self.followed, equipment=equipment)
        return Axis(trim=isolated(STARTING_SECONDS, trimmed, condition or FlightCondition()), followed=followed)

    def loops(self, model: Axis) -> tuple[Axis]:
        return (model,)

    def pilot(self, model: Axis, aboard: Aboard) -> Step:
        (only,) = aboard.loops
        return only.step()

    def fly(
        self, model: Axis, pilot: Step, failures: Sequence[Failure], dispersion: Dispersion, timing: Timing
    ) -> list[AxisFlight]:
        return [fly_once(model, pilot, failure, dispersion, timing) for failure in failures]

    def delayed(self, seconds: float) -> Failure:
        return Failure(name="delay", meaning="", delay=seconds)

    def broken(self, controller: str, failure: Failure, why: str) -> AxisFlight:
        record = np.zeros((1, len(self.columns)))
        return AxisFlight(controller=controller, failure=failure, followed=self.followed, record=record, lost=why)

    def contents(self, model: Axis, aboard: Sequence[Aboard]) -> Iterator[bytes]:
        lists = [one for several in aboard for one in several.loops if isinstance(one, SampledList)]
        yield repr([(one.name, one.program, one.initial.tolist()) for one in lists]).encode()
        yield model.trim.A.tobytes() + model.trim.B.tobytes()

    @property
    def columns(self) -> dict[str, str]:
        return columns_of(self.followed)

    @property
    def units(self) -> dict[str, str]:
        return figures_of(self.followed)

    @property
    def panels(self) -> tuple[Shown[AxisFlight], ...]:
        rate, surface = self.followed.rate, self.followed.surface
        beside = {"alpha": (r"Angle of attack $\alpha$", "[deg]"), "n_z": ("Load factor $n_z$", "[g]")}
        if self.followed.attitude == "phi":
            beside = {"bank": (r"Bank angle $\phi$", "[deg]"), "beta": (r"Angle of sideslip $\beta$", "[deg]")}
        asked = ((f"{rate}_m", "model", "ink", 1), (f"{rate}_c", "command", "quiet", 2))
        return (
            Shown(f"{RATES[rate]} ${rate}$", "[deg/s]", partial(_column, rate), asked),
            *(Shown(title, unit, partial(_column, name)) for name, (title, unit) in beside.items()),
            Shown(f"{surface.capitalize()}, the surface itself", "[deg]", partial(_column, surface)),
        )

    def headline(self, model: Axis) -> str:
        return f"{self.name} at {model.trim.condition}: RMS error of the controlled rate [deg/s] after each failure"

    def cells(self, figures: Mapping[str, float | None]) -> list[str]:
        surface = f"{self.followed.surface}_travel"
        error, largest, low, high, alpha, travel = (
            "-" if figures[name] is None else f"{figures[name]:.2f}"
            for name in ("rms_e", "max_abs_e", "n_z_min", "n_z_max", "alpha_max", surface)
        )
        return [error, largest, f"{low} to {high}", alpha, travel]

    def facts(self, model: Axis, version: str) -> list[tuple[str, str]]:
        trim = model.trim
        alpha, elevator = np.rad2deg([trim.alpha, trim.elevator])
        modes = "; ".join(f"{name} {_mode(values)}" for name, values in trim.modes().items() if values)
        return [
            ("trim", f"{trim.condition}: alpha {alpha:.2f} deg, elevator {elevator:.2f} deg, throttle {trim.throttle:.2f}"),
            ("modes", f"{modes} [1/s]"),
            (
                "computed",
                f"JSBSim {version}, {INTEGRATOR}, {1 / STEP:g} Hz; control at {1 / SAMPLE_TIME:g} Hz, {TIMING.duration:g} s",
            ),
        ]

    def details(self, model: Axis, version: str) -> dict[str, Any]:
        trim, axis = model.trim, model
        A, b = axis.model
        return {
            "condition": {"altitude_ft": trim.condition.altitude, "mach": trim.condition.mach},
            "trim": {
                "speed_ft_s": trim.speed,
                "alpha_deg": float(np.rad2deg(trim.alpha)),
                "elevator_deg": float(np.rad2deg(trim.elevator)),
                "throttle": trim.throttle,
            },
            "modes": {name: [[value.real, value.imag] for value in values] for name, values in trim.modes().items()},
            "design": {"A": A.tolist(), "b": b.tolist(), "gain": axis.gain.tolist(), "A_m": axis.A_m.tolist(), "k_0": axis.k_0},
            "equipment": asdict(axis.equipment),
            "simulation": {
                "simulator": f"JSBSim {version}", "integrator": INTEGRATOR, "dt": STEP, "sample_time": SAMPLE_TIME,
                "t_end": TIMING.duration, "fails_at": FAILS_AT,
            },
        }  # fmt: skip


def _column(name: str, flight: AxisFlight) -> Array:
    return flight.column(name)


def _mode(values: list[complex]) -> str:
    first = values[0]
    return f"{first.real:.3g} +- {abs(first.imag):.3g}j" if first.imag else ", ".join(f"{one.real:.3g}" for one in values)


def _vehicle(followed: Followed) -> F16:
    name = followed.name
    return F16(
        name=name,
        meaning=followed.meaning,
        followed=followed,
        failures=FAILURES[name],
        schemes=SCHEMES,
        numbers={name: TUNED[name]},
        timing=TIMING,
        drawing=Drawing(
            drawn=DRAWN,
            units=UNITS,
            conditions={str(condition): condition for condition in CONDITIONS},
            timing=CAMPAIGN_TIMING,
            travel=(f"{followed.surface}_travel", "surface"),
            beside=("LQR with PI", "PI"),
            set_by="one rule for all (benchmarks/flight_tuning.py): smallest RMS error on the linearised aircraft with a delay "
            "margin of 0.1 s and a gain margin of 2",
            chunk=256,
        ),
    )


VEHICLES = tuple(_vehicle(followed) for followed in AXES.values())
