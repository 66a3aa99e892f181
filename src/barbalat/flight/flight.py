"""One flight: a sampled controller on the moving aircraft, and a failure on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from barbalat.flight import f16
from barbalat.flight.airframe import STEP, Airframe, Surfaces
from barbalat.flight.equipment import Elevator, Sensors
from barbalat.flight.failures import FAILS_AT, Failure
from barbalat.flight.gusts import vertical_gusts
from barbalat.flight.pitch import COMMANDED, SAMPLE_TIME, PitchAxis
from barbalat.flight.sampled_step import SampledList, SampledStep
from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.signals import Steps
from barbalat.validate import Array

DURATION = 30.0
"""[s]."""
COMMAND = Steps(
    times=tuple(start + lag for start in (1.0, 11.0, 21.0) for lag in (0.0, 2.0, 4.0, 6.0)),
    values=(COMMANDED, 0.0, -COMMANDED, 0.0) * 3,
)
"""The commanded pitch rate: up for two seconds and down for two, each ten seconds."""
COLUMNS = {
    "t": "s",
    "q_c": "deg/s",
    "q_m": "deg/s",
    "q": "deg/s",
    "alpha": "deg",
    "n_z": "g",
    "elevator_command": "deg",
    "elevator": "deg",
    "pitch": "deg",
    "altitude": "ft",
    "speed": "ft/s",
}
"""What is recorded at each sample, in this order, with its unit."""


FIGURES = {
    "rms_e": "deg/s",
    "max_abs_e": "deg/s",
    "n_z_min": "g",
    "n_z_max": "g",
    "alpha_min": "deg",
    "alpha_max": "deg",
    "elevator_travel": "deg/s",
    "elevator_max_abs": "deg",
}
"""Of a flight, with their units; e is the pitch rate less the model's, the travel how far the surface moves in a second."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """What was flown.

    record   (K, 11), one row for each sample, see ``COLUMNS``; up to where control was lost
    lost     why control was lost, empty where it was not
    """

    controller: str
    failure: Failure
    record: Array
    lost: str

    def column(self, name: str) -> Array:
        """One of ``COLUMNS`` over the samples."""
        return np.asarray(self.record[:, list(COLUMNS).index(name)])

    @property
    def duration(self) -> float:
        """The last sample's time [s]."""
        return float(self.record[-1, 0])

    @property
    def lost_at(self) -> float | None:
        """[s]."""
        return self.duration if self.lost else None

    @property
    def rms_error(self) -> float:
        """Of the pitch rate against the model's, from ``FAILS_AT`` on [deg/s]."""
        return float(np.sqrt(np.mean(self._error**2)))

    @property
    def figures(self) -> dict[str, float | None]:
        """From ``FAILS_AT`` on, by the names of the JSON; null where control was lost."""
        after = self.record[self.record[:, 0] >= FAILS_AT]
        if self.lost or not len(after):
            return {"lost_at": self.lost_at, **dict.fromkeys(FIGURES)}
        load, alpha, surface = (self.column(name)[-len(after) :] for name in ("n_z", "alpha", "elevator"))
        values = (
            self.rms_error, np.abs(self._error).max(), load.min(), load.max(), alpha.min(), alpha.max(),
            np.abs(np.diff(surface)).sum() / (len(after) * SAMPLE_TIME), np.abs(surface).max(),
        )  # fmt: skip
        return {"lost_at": None, **dict(zip(FIGURES, map(float, values), strict=True))}

    @property
    def _error(self) -> Array:
        after = self.column("t") >= FAILS_AT
        return np.asarray((self.column("q") - self.column("q_m"))[after])


def flown(axis: PitchAxis, contents: SampledList, failures: Sequence[Failure]) -> list[Flight]:
    """One controller through the failures, in this process."""
    step = SampledStep(contents)
    return [_fly(axis, step, failure) for failure in failures]


DELAY_STEP = 0.01
"""[s] to which the largest delay is found: a sample."""
COARSE, MOST = 5, 50
"""DELAY_STEPs from one trial to the next until control is lost, and the last of them."""


def delay_borne(axis: PitchAxis, contents: SampledList) -> float:
    """The largest added delay [s] with which control is kept to the end, to DELAY_STEP: by trials upwards, then by bisection.

    COARSE * DELAY_STEP at least, or 0.0, lie between it and a delay that lost control; MOST * DELAY_STEP where none did.
    """
    step = SampledStep(contents)

    def lost(delay: int) -> bool:
        return bool(_fly(axis, step, Failure(name="delay", meaning="", delay=delay * DELAY_STEP)).lost)

    high = next((trial for trial in range(COARSE, MOST + 1, COARSE) if lost(trial)), None)
    if high is None:
        return MOST * DELAY_STEP
    low = high - COARSE
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if lost(middle) else (middle, high)
    return low * DELAY_STEP


def _fly(axis: PitchAxis, controller: SampledStep, failure: Failure) -> Flight:
    trim = axis.trim
    airframe, elevator, sensors = _at_trim(axis)
    controller.reset()
    samples, failing = round(DURATION / SAMPLE_TIME), round(FAILS_AT / SAMPLE_TIME)
    commands = COMMAND(SAMPLE_TIME * np.arange(samples))
    gusts = vertical_gusts(failure.gusts, trim.speed, SAMPLE_TIME, samples)
    model, trimmed = _model(axis, commands), np.rad2deg([trim.alpha, 0.0])
    record, effectiveness, lost = np.zeros((samples, len(COLUMNS))), 1.0, ""
    for k in range(samples):
        if k == failing:
            effectiveness = failure.effectiveness
            airframe.shift_ballast(failure.ballast_aft)
            elevator.delay_more(failure.delay)
            elevator.run_away(failure.runs_away)
        if k >= failing:
            airframe.blow(gusts[k])
        command = float(np.rad2deg(trim.elevator) + controller(sensors.output, commands[k])[0])
        record[k] = k * SAMPLE_TIME, commands[k], model[k], *_seen(airframe), command, elevator.deflection, *_flown_to(airframe)
        lost = _lost(record[k])
        if lost:
            record = record[: k + 1]
            break
        for _ in range(round(SAMPLE_TIME / STEP)):
            airframe.move(Surfaces(effectiveness * np.deg2rad(elevator.advance(command))))
            airframe.fdm.run()
            sensors.advance(np.rad2deg(airframe.alpha_and_q) - trimmed)
    return Flight(controller=controller.contents.name, failure=failure, record=record, lost=lost)


def _at_trim(axis: PitchAxis) -> tuple[Airframe, Elevator, Sensors]:
    trim, equipment = axis.trim, axis.equipment
    airframe = Airframe(trim.condition)
    airframe.put(trim.motion, Surfaces(trim.elevator), trim.throttle)
    return airframe, Elevator(equipment, STEP, float(np.rad2deg(trim.elevator))), Sensors(equipment, STEP)


def _seen(airframe: Airframe) -> tuple[float, float, float]:
    """q [deg/s], alpha [deg], n_z [g]."""
    alpha, q = np.rad2deg(airframe.alpha_and_q)
    return q, alpha, airframe.load_factor


def _flown_to(airframe: Airframe) -> tuple[float, float, float]:
    """Pitch [deg], altitude [ft], speed [ft/s]."""
    motion = airframe.motion
    return float(np.rad2deg(motion.theta)), airframe.altitude, motion.speed


def _lost(row: Array) -> str:
    """Where the aircraft leaves what its tables cover, or what its structure bears."""
    if not np.isfinite(row).all():
        return "the simulation's numbers are no longer finite"
    (low, high), (least, most) = f16.REACHED_ALPHA, f16.LIMIT_LOADS
    if not low <= row[4] <= high:
        return f"the angle of attack left {low:g} to {high:g} deg, where the tables end"
    if not least <= row[5] <= most:
        return f"the load factor left {least:g} to {most:g} g, which the structure bears"
    return ""


def _model(axis: PitchAxis, commands: Array) -> Array:
    """The pitch rate of the model to follow, at the samples."""
    _, b = axis.trim.short_period
    held = HeldSystem.of(axis.A_m, b * axis.k_0, SAMPLE_TIME)
    x, found = np.zeros(2), []
    for r in commands:
        found.append(x[1])
        x = held.following(x, r)
    return np.array(found)
