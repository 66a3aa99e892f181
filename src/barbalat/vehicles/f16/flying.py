"""The flight of a controller on the moving aircraft, sample by sample, with a failure during the flight."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.run.kernel.sampled_controller import Step
from barbalat.validate import Array
from barbalat.vehicles.f16 import model as f16
from barbalat.vehicles.f16.airframe import DEGREES, STEP, Airframe
from barbalat.vehicles.f16.axis import PITCH, SAMPLE_TIME, Axis
from barbalat.vehicles.f16.dispersions import NOMINAL, Dispersion
from barbalat.vehicles.f16.equipment import Actuator, Sensors
from barbalat.vehicles.f16.failures import Failure
from barbalat.vehicles.f16.flight import ALPHA, BANK, BETA, COMMAND, N_Z, TIMING, AxisFlight, columns_of
from barbalat.vehicles.f16.trim import Trim
from barbalat.vehicles.flight import NO_NUMBER, Timing

if TYPE_CHECKING:
    from jsbsim import FGPropertyNode

SUBSTEPS = range(round(SAMPLE_TIME / STEP))
"""Number of simulator steps per sample."""


def fly_once(
    axis: Axis, controller: Step, failure: Failure, dispersion: Dispersion = NOMINAL, timing: Timing = TIMING
) -> AxisFlight:
    """Fly once from trim, or from the start of a dispersion."""
    aircraft = _Aircraft.at_start(axis, dispersion)
    controller.reset()
    samples, failing = round(timing.duration / SAMPLE_TIME), round(timing.fails_at / SAMPLE_TIME)
    commands = axis.followed.command(SAMPLE_TIME * np.arange(samples))
    air, model = _air(axis, failure, dispersion, samples, failing), _model(axis, commands)
    record, lost = np.zeros((samples, len(columns_of(axis.followed)))), ""
    for k in range(samples):
        if k == failing:
            aircraft.fail(failure)
        aircraft.airframe.blow(*air[k])
        command = axis.surface_trim + float(controller(aircraft.sensors.output, commands[k])[0])
        record[k] = (k * SAMPLE_TIME, commands[k], model[k], *aircraft.seen(command))
        lost = _lost(record[k])
        if lost:
            record = record[: k + 1]
            break
        aircraft.advance(command)
    return AxisFlight(
        controller=controller.name,
        failure=failure,
        followed=axis.followed,
        record=record,
        lost=lost,
        timing=timing,
        agreement=controller.agreement(),
    )


@dataclass(kw_only=True)
class _Aircraft:
    """The flying part of one axis: the airframe and the hardware between it and the controller.

    effectiveness  factor of the surface's effectiveness, after a dispersion and a failure
    surface        surface deflection that the tables of the airframe read [rad]
    states         inputs of the sensors, as deviations from trim
    hold           the controller that holds the pitch axis at trim while another axis is flown; None if the pitch axis is flown
    place, ground  the distance north and east of the start, and the velocity in these directions [ft, ft/s]
    """

    axis: Axis
    airframe: Airframe
    actuator: Actuator
    sensors: Sensors
    effectiveness: float
    surface: FGPropertyNode
    states: Callable[[], list[float]]
    hold: _PitchHold | None
    place: tuple[float, float]
    ground: tuple[float, float]

    @classmethod
    def at_start(cls, axis: Axis, dispersion: Dispersion) -> _Aircraft:
        """Return the aircraft in trim, except for the changes of a dispersion."""
        trim, equipment, off = axis.trim, axis.equipment, np.deg2rad(dispersion.attitude)
        airframe = Airframe(trim.condition)
        airframe.load(dispersion.load)
        airframe.shift_ballast(dispersion.ballast_aft)
        for coefficient, factor in dispersion.scales.items():
            airframe.scale(coefficient, factor)
        start = trim.motion._replace(
            speed=trim.speed * dispersion.speed, alpha=trim.motion.alpha + off, theta=trim.motion.theta + off
        )
        airframe.put(start, trim.surfaces, trim.throttle)
        actuator = Actuator(equipment, STEP, axis.surface_trim)
        actuator.delay_more(dispersion.delay)
        trimmed = np.rad2deg(np.array(trim.motion)[list(axis.followed.places)]).tolist()
        return cls(
            axis=axis,
            airframe=airframe,
            actuator=actuator,
            sensors=Sensors(equipment, STEP, len(axis.followed.states)),
            effectiveness=dispersion.effectiveness,
            surface=airframe.surface(axis.surface),
            states=airframe.seeing(axis.followed.states, trimmed),
            hold=None if axis.followed.surface == "elevator" else _PitchHold.of(airframe, trim),
            place=(0.0, 0.0),
            ground=airframe.ground_velocity,
        )

    def fail(self, failure: Failure) -> None:
        """Apply the failure. Its gusts are already part of the air's motion."""
        self.effectiveness *= failure.effectiveness
        self.airframe.shift_ballast(failure.ballast_aft, failure.ballast_right)
        self.actuator.delay_more(failure.delay)
        self.actuator.run_away(failure.runs_away)

    def seen(self, command: float) -> tuple[float, ...]:
        """Return the columns of the record from the followed rate on."""
        motion = self.airframe.motion
        rate, alpha, beta = np.rad2deg([motion[self.axis.followed.places[self.axis.rate]], motion.alpha, motion.beta])
        return (
            rate, alpha, beta, self.airframe.load_factor, command, self.actuator.deflection,
            *np.rad2deg([motion.theta, motion.phi]), self.airframe.altitude, motion.speed, self.airframe.heading, *self.place,
        )  # fmt: skip

    def advance(self, command: float) -> None:
        """Fly for one sample with this surface command."""
        for _ in SUBSTEPS:
            self.surface.set_double_value(self.effectiveness * self.actuator.advance(command) / DEGREES)
            if self.hold is not None:
                self.hold()
            self.airframe.fdm.run()
            self.sensors.advance(self.states())
        before, self.ground = self.ground, self.airframe.ground_velocity
        (north, east), half = self.place, SAMPLE_TIME / 2
        self.place = north + half * (before[0] + self.ground[0]), east + half * (before[1] + self.ground[1])


@dataclass(frozen=True, kw_only=True)
class _PitchHold:
    """The linear-quadratic feedback of the pitch axis, without lag. It is needed because the airframe may be unstable in pitch
    while the comparison concerns a different axis."""

    elevator: FGPropertyNode
    states: Callable[[], list[float]]
    gain: tuple[float, ...]
    trimmed: float

    @classmethod
    def of(cls, airframe: Airframe, trim: Trim) -> _PitchHold:
        pitch = Axis(trim=trim, followed=PITCH)
        at = np.rad2deg(np.array(trim.motion)[list(PITCH.places)]).tolist()
        return cls(
            elevator=airframe.surface(pitch.surface),
            states=airframe.seeing(PITCH.states, at),
            gain=tuple(pitch.gain.tolist()),
            trimmed=pitch.surface_trim,
        )

    def __call__(self) -> None:
        limit, asked = PITCH.equipment.limit, self.trimmed
        for gain, off in zip(self.gain, self.states(), strict=True):
            asked -= gain * off
        self.elevator.set_double_value(min(max(asked, -limit), limit) / DEGREES)


def _air(axis: Axis, failure: Failure, dispersion: Dispersion, samples: int, failing: int) -> list[tuple[float, float]]:
    """Return the velocity of the air, down and east, at each sample: gusts of a dispersion during the whole flight, and gusts of
    a failure from its time on."""
    seeds = SEED + 2 * dispersion.number, SEED + 2 * dispersion.number + 1
    failed, drawn = (
        gusts_met(deviation, axis.trim.speed, SAMPLE_TIME, samples, seed)
        for deviation, seed in zip((failure.gusts, dispersion.gusts), seeds, strict=True)
    )
    met = drawn + np.where(np.arange(samples) < failing, 0.0, failed)
    still = np.zeros(samples)
    down, east = (still, met) if axis.followed.attitude == "phi" else (met, still)
    return list(zip(down.tolist(), east.tolist(), strict=True))


MOST_BANK, MOST_BETA = 90.0, 30.0
"""Largest bank and sideslip [deg]. Commands need at most 30 deg of bank, and beyond 90 the lift points down. The tables end at
30 deg of sideslip."""


def _lost(row: Array) -> str:
    """Return why the aircraft is lost: it left the range of its tables, the limits of its structure, or the required attitude.
    The text is empty if the aircraft is not lost."""
    if not np.isfinite(row[COMMAND]):
        return NO_NUMBER
    if not np.isfinite(row).all():
        return "the simulation's numbers are no longer finite"
    (low, high), (least, most) = f16.REACHED_ALPHA, f16.LIMIT_LOADS
    if not low <= row[ALPHA] <= high:
        return f"the angle of attack left {low:g} to {high:g} deg, where the tables end"
    if not least <= row[N_Z] <= most:
        return f"the load factor left {least:g} to {most:g} g, which the structure tolerates"
    if not abs(row[BETA]) <= MOST_BETA:
        return f"the angle of sideslip passed {MOST_BETA:g} deg, where the tables end"
    if not abs(row[BANK]) <= MOST_BANK:
        return f"the bank angle passed {MOST_BANK:g} deg"
    return ""


def _model(axis: Axis, commands: Array) -> Array:
    """Return the rate of the reference model at the samples."""
    _, b = axis.model
    held = HeldSystem.of(axis.A_m, b * axis.k_0, SAMPLE_TIME)
    x, found = np.zeros(len(b)), []
    for r in commands:
        found.append(x[axis.rate])
        x = held.following(x, r)
    return np.array(found)


TURBULENCE_LENGTH = 1750.0
"""Scale of turbulence L [ft] above 2000 ft, from MIL-F-8785C, section 3.7.2."""
SEED = 2013


def gusts_met(deviation: float, speed: float, T: float, samples: int, seed: int = SEED) -> Array:
    """Return gust velocities (samples,), T [s] apart, with this standard deviation and unit, for an aircraft with this airspeed
    [ft/s].

    They are white noise of unit intensity filtered by deviation sqrt(tau) (1 + sqrt(3) tau s)/(1 + tau s)^2 with tau =
    SCALE/speed. They are exact at the samples and stationary from the first sample on.
    """
    return deviation * _of_one(speed, T, samples, seed)


@lru_cache(maxsize=8)  # all flights of a draw have the same gusts
def _of_one(speed: float, T: float, samples: int, seed: int) -> Array:
    """Return gusts (samples,) with a standard deviation of 1."""
    tau = TURBULENCE_LENGTH / speed
    A = np.array([[0.0, 1.0], [-1 / tau**2, -2 / tau]])
    C = np.sqrt(tau) * np.array([1 / tau**2, np.sqrt(3) / tau])
    # Van Loan (1978): exp([[-A, b b'], [0, A']] T) gives the covariance that the noise adds in a sample
    whole = np.zeros((4, 4))
    whole[:2, :2], whole[2:, 2:], whole[1, 3] = -A, A.T, 1.0
    found = HeldSystem.of(whole, np.zeros(4), T).Phi
    Phi = found[2:, 2:].T
    added = Phi @ found[:2, 2:]
    random, root = np.random.default_rng(seed), np.linalg.cholesky(added)
    x = np.linalg.cholesky(solve_discrete_lyapunov(Phi, added)) @ random.standard_normal(2)
    gusts = np.empty(samples)
    for k in range(samples):
        gusts[k] = C @ x
        x = Phi @ x + root @ random.standard_normal(2)
    gusts.flags.writeable = False
    return gusts
