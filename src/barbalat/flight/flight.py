"""One flight: a sampled controller on the moving aircraft, and a failure on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from barbalat.flight import f16
from barbalat.flight.airframe import DEGREES, STEP, Airframe, Motion
from barbalat.flight.axis import SAMPLE_TIME, Axis, Followed
from barbalat.flight.dispersions import NOMINAL, Dispersion
from barbalat.flight.equipment import Actuator, Sensors
from barbalat.flight.failures import FAILS_AT, Failure
from barbalat.flight.gusts import SEED, gusts_met
from barbalat.flight.sampled_step import SampledList, SampledStep
from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.validate import Array


@dataclass(frozen=True, kw_only=True)
class Timing:
    """How long a flight is, and when what fails does [s]."""

    duration: float = 30.0
    fails_at: float = FAILS_AT


TIMING = Timing()


def columns_of(followed: Followed) -> dict[str, str]:
    """What is recorded at each sample, in this order, with its unit."""
    rate, surface = followed.rate, followed.surface
    rates, angles = (f"{rate}_c", f"{rate}_m", rate), ("alpha", "beta")
    surfaces, attitude = (f"{surface}_command", surface), ("pitch", "bank")
    return {
        "t": "s", **dict.fromkeys(rates, "deg/s"), **dict.fromkeys(angles, "deg"), "n_z": "g",
        **dict.fromkeys((*surfaces, *attitude), "deg"), "altitude": "ft", "speed": "ft/s",
    }  # fmt: skip


T, COMMANDED, MODEL, RATE, ALPHA, BETA, N_Z, COMMAND, SURFACE, PITCH, BANK, ALTITUDE, SPEED = range(13)
"""Places of these columns."""


def figures_of(followed: Followed) -> dict[str, str]:
    """Of a flight, with their units; e is the followed rate less the model's, travel how far the surface moves in a second."""
    surface = followed.surface
    return {
        "rms_e": "deg/s",
        "max_abs_e": "deg/s",
        "n_z_min": "g",
        "n_z_max": "g",
        "alpha_min": "deg",
        "alpha_max": "deg",
        f"{surface}_travel": "deg/s",
        f"{surface}_max_abs": "deg",
    }


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """What was flown.

    record   (K, 13), one row for each sample, see ``columns_of``; up to where control was lost
    lost     why control was lost, empty where it was not
    """

    controller: str
    failure: Failure
    followed: Followed
    record: Array
    lost: str
    timing: Timing = TIMING

    def column(self, name: str) -> Array:
        """One of ``columns_of`` over the samples."""
        return np.asarray(self.record[:, list(columns_of(self.followed)).index(name)])

    @property
    def duration(self) -> float:
        """The last sample's time [s]."""
        return float(self.record[-1, T])

    @property
    def lost_at(self) -> float | None:
        """[s]."""
        return self.duration if self.lost else None

    @property
    def rms_error(self) -> float:
        """Of the followed rate against the model's, from the failure on [deg/s]."""
        return float(np.sqrt(np.mean(self._error**2)))

    @property
    def figures(self) -> dict[str, float | None]:
        """From the failure on, by the names of the JSON; null where control was lost."""
        after, names = self._after, figures_of(self.followed)
        if self.lost or not len(after):
            return {"lost_at": self.lost_at, **dict.fromkeys(names)}
        load, alpha, surface = (after[:, place] for place in (N_Z, ALPHA, SURFACE))
        values = (
            self.rms_error, np.abs(self._error).max(), load.min(), load.max(), alpha.min(), alpha.max(),
            np.abs(np.diff(surface)).sum() / (len(after) * SAMPLE_TIME), np.abs(surface).max(),
        )  # fmt: skip
        return {"lost_at": None, **dict(zip(names, map(float, values), strict=True))}

    @property
    def _after(self) -> Array:
        return self.record[self.record[:, T] >= self.timing.fails_at]

    @property
    def _error(self) -> Array:
        return np.asarray(self._after[:, RATE] - self._after[:, MODEL])


def flown(axis: Axis, contents: SampledList, failures: Sequence[Failure]) -> list[Flight]:
    """One controller through the failures, in this process."""
    step = SampledStep(contents)
    return [fly_once(axis, step, failure) for failure in failures]


DELAY_STEP = 0.01
"""[s] to which the largest delay is found: a sample."""
COARSE, MOST = 5, 50
"""DELAY_STEPs from one trial to the next until control is lost, and the last of them."""


def delay_borne(axis: Axis, contents: SampledList) -> float:
    """The largest added delay [s] with which control is kept to the end, to DELAY_STEP: by trials upwards, then by bisection.

    COARSE * DELAY_STEP at least, or 0.0, lie between it and a delay that lost control; MOST * DELAY_STEP where none did.
    """
    step = SampledStep(contents)

    def lost(delay: int) -> bool:
        return bool(fly_once(axis, step, Failure(name="delay", meaning="", delay=delay * DELAY_STEP)).lost)

    high = next((trial for trial in range(COARSE, MOST + 1, COARSE) if lost(trial)), None)
    if high is None:
        return MOST * DELAY_STEP
    low = high - COARSE
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if lost(middle) else (middle, high)
    return low * DELAY_STEP


def fly_once(
    axis: Axis, controller: SampledStep, failure: Failure, dispersion: Dispersion = NOMINAL, timing: Timing = TIMING
) -> Flight:
    """From trim, or from what a dispersion makes of it."""
    airframe, actuator, sensors = _at_start(axis, dispersion)
    controller.reset()
    samples, failing = round(timing.duration / SAMPLE_TIME), round(timing.fails_at / SAMPLE_TIME)
    commands = axis.followed.command(SAMPLE_TIME * np.arange(samples))
    air = _air(axis, failure, dispersion, samples, failing)
    model, places = _model(axis, commands), list(axis.followed.places)
    trimmed, moved = np.rad2deg(np.array(axis.trim.motion)[places]).tolist(), airframe.surface(axis.surface)
    record, effectiveness, lost = np.zeros((samples, len(columns_of(axis.followed)))), dispersion.effectiveness, ""
    substeps, seen = range(round(SAMPLE_TIME / STEP)), airframe.seeing(axis.followed.states, trimmed)
    for k in range(samples):
        if k == failing:
            effectiveness *= failure.effectiveness
            airframe.shift_ballast(failure.ballast_aft, failure.ballast_right)
            actuator.delay_more(failure.delay)
            actuator.run_away(failure.runs_away)
        airframe.blow(*air[k])
        command = axis.surface_trim + float(controller(sensors.output, commands[k])[0])
        motion = airframe.motion
        record[k] = (
            k * SAMPLE_TIME, commands[k], model[k], *_seen(axis, airframe, motion), command, actuator.deflection,
            *np.rad2deg([motion.theta, motion.phi]), airframe.altitude, motion.speed,
        )  # fmt: skip
        lost = _lost(record[k])
        if lost:
            record = record[: k + 1]
            break
        for _ in substeps:
            moved.set_double_value(effectiveness * actuator.advance(command) / DEGREES)
            airframe.fdm.run()
            sensors.advance(seen())
    return Flight(
        controller=controller.contents.name, failure=failure, followed=axis.followed, record=record, lost=lost, timing=timing
    )


def _at_start(axis: Axis, dispersion: Dispersion) -> tuple[Airframe, Actuator, Sensors]:
    trim, equipment = axis.trim, axis.equipment
    airframe = Airframe(trim.condition)
    airframe.load(dispersion.load)
    airframe.shift_ballast(dispersion.ballast_aft)
    for coefficient, factor in dispersion.scales.items():
        airframe.scale(coefficient, factor)
    off = np.deg2rad(dispersion.attitude)
    start = trim.motion._replace(
        speed=trim.speed * dispersion.speed, alpha=trim.motion.alpha + off, theta=trim.motion.theta + off
    )
    airframe.put(start, trim.surfaces, trim.throttle)
    actuator = Actuator(equipment, STEP, axis.surface_trim)
    actuator.delay_more(dispersion.delay)
    return airframe, actuator, Sensors(equipment, STEP, len(axis.followed.states))


def _air(axis: Axis, failure: Failure, dispersion: Dispersion, samples: int, failing: int) -> list[tuple[float, float]]:
    """Down and east at each sample: a dispersion's gusts all the way, those that a failure brings from then on."""
    seeds = SEED + 2 * dispersion.number, SEED + 2 * dispersion.number + 1
    failed, drawn = (
        gusts_met(deviation, axis.trim.speed, SAMPLE_TIME, samples, seed)
        for deviation, seed in zip((failure.gusts, dispersion.gusts), seeds, strict=True)
    )
    met = drawn + np.where(np.arange(samples) < failing, 0.0, failed)
    still = np.zeros(samples)
    down, east = (still, met) if axis.followed.attitude == "phi" else (met, still)
    return list(zip(down.tolist(), east.tolist(), strict=True))


def _seen(axis: Axis, airframe: Airframe, motion: Motion) -> tuple[float, float, float, float]:
    """The followed rate [deg/s], alpha, beta [deg], n_z [g]."""
    rate, alpha, beta = np.rad2deg([motion[axis.followed.places[axis.rate]], motion.alpha, motion.beta])
    return rate, alpha, beta, airframe.load_factor


MOST_BANK, MOST_BETA = 90.0, 30.0
"""[deg]; commands ask for 30 deg of bank at most, and beyond 90 the lift pulls down. The tables end at 30 deg of sideslip."""


def _lost(row: Array) -> str:
    """Where the aircraft leaves what its tables cover, what its structure bears, or the attitude that it was to keep."""
    if not np.isfinite(row).all():
        return "the simulation's numbers are no longer finite"
    (low, high), (least, most) = f16.REACHED_ALPHA, f16.LIMIT_LOADS
    if not low <= row[ALPHA] <= high:
        return f"the angle of attack left {low:g} to {high:g} deg, where the tables end"
    if not least <= row[N_Z] <= most:
        return f"the load factor left {least:g} to {most:g} g, which the structure bears"
    if not abs(row[BETA]) <= MOST_BETA:
        return f"the angle of sideslip passed {MOST_BETA:g} deg, where the tables end"
    if not abs(row[BANK]) <= MOST_BANK:
        return f"the bank angle passed {MOST_BANK:g} deg"
    return ""


def _model(axis: Axis, commands: Array) -> Array:
    """The followed rate of the model to follow, at the samples."""
    _, b = axis.model
    held = HeldSystem.of(axis.A_m, b * axis.k_0, SAMPLE_TIME)
    x, found = np.zeros(len(b)), []
    for r in commands:
        found.append(x[axis.rate])
        x = held.following(x, r)
    return np.array(found)
