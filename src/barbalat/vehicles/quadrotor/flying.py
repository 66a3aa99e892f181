"""The flight of a scheme on the moving vehicle, sample by sample, with a failure during the flight."""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from barbalat.validate import Array
from barbalat.vehicles.flight import NO_NUMBER, Timing
from barbalat.vehicles.quadrotor.axes import ATTITUDE_SAMPLE, Axes, Electronics
from barbalat.vehicles.quadrotor.body import STANDING, STEP
from barbalat.vehicles.quadrotor.control import OUTER_EVERY, Control, Memory
from barbalat.vehicles.quadrotor.dispersions import NOMINAL, Dispersion
from barbalat.vehicles.quadrotor.failures import Failure
from barbalat.vehicles.quadrotor.flight import TIMING, QuadrotorFlight
from barbalat.vehicles.quadrotor.simulator import ROTORS, Motion
from barbalat.vehicles.quadrotor.trajectory import CLIMBS, TAKES_OFF, path

LARGEST_DISTANCE, LARGEST_TILT, LEAST_HEIGHT = 3.0, 85.0, STANDING + 0.02
"""Limits beyond which the vehicle is lost: distance from its path [m], tilt [deg], and smallest height above the ground [m]."""


def fly_all(
    axes: Axes, control: Control, failures: Sequence[Failure], dispersion: Dispersion = NOMINAL, timing: Timing = TIMING
) -> list[QuadrotorFlight]:
    """Fly through each failure. The common part before the failure is flown once."""

    def at_failure(*, stale: bool = False) -> _Vehicle:
        found = _Vehicle(axes, control, dispersion, timing, stale=stale)
        found.advance_to(timing.fails_at)
        return found

    flights: list[QuadrotorFlight] = []
    common: _Vehicle | None = None
    for failure in failures:
        if failure.stale or not control.resumable:
            vehicle = at_failure(stale=failure.stale)
        else:
            common = common or at_failure()
            vehicle = common.copied()
        vehicle.fail(failure)
        vehicle.advance_to(timing.duration)
        flights.append(vehicle.flight(failure))
    return flights


class _Vehicle:
    """A vehicle in flight.

    stale   whether the reset of the laws is omitted when they take over control
    k       the index of the next sample
    record  rows of ``flight.COLUMNS``
    lost    the reason for the loss, empty as long as the vehicle is not lost
    """

    def __init__(self, axes: Axes, control: Control, dispersion: Dispersion, timing: Timing, *, stale: bool = False) -> None:
        self.control, self.dispersion, self.timing, self.stale = control, dispersion, timing, stale
        nominal, T = axes.hover.vehicle, ATTITUDE_SAMPLE
        electronics = dispersion.electronics(axes.electronics)
        self.most, self.samples = nominal.thrust, round(timing.duration / T)
        self.simulator = dispersion.simulator(nominal)
        self.planned = path(T, self.samples)
        self.sensing = Sensing(electronics, self.samples, dispersion.number)
        self.air = Air.drawn(dispersion, self.samples)
        self.waiting = deque([np.zeros(ROTORS)] * round(electronics.delay / T))
        self.record: list[list[float]] = []
        self.k, self.limited, self.lost = 0, 0, ""
        control.reset(np.eye(3), np.zeros(3))
        self.memory = self._memory()

    def _memory(self) -> Memory | None:
        return self.control.memory if self.control.resumable else None

    def copied(self) -> _Vehicle:
        """Return an independent copy in the same state, with the same controller."""
        found = copy.copy(self)
        found.simulator, found.sensing = self.simulator.copied(), copy.copy(self.sensing)
        found.waiting, found.record = self.waiting.copy(), self.record.copy()
        return found

    def fail(self, failure: Failure) -> None:
        """Apply the failure."""
        if failure.slung is not None:
            self.simulator.hook_on(failure.slung)
        if failure.motor_lag is not None:
            self.simulator.slow_down(failure.motor_lag)
        self.simulator.weaken(0, failure.effectiveness * self.dispersion.effectiveness[0])
        self.waiting.extendleft([self.waiting[0]] * round(failure.delay / ATTITUDE_SAMPLE))
        self.air = self.air.failing(failure, self.dispersion, self.samples)

    def advance_to(self, seconds: float) -> None:
        """Fly up to this instant, or until the vehicle is lost."""
        if self.memory is not None:
            self.control.memory = self.memory
        while self.k < round(seconds / ATTITUDE_SAMPLE) and not self.lost:
            self._sample(self.k)
            self.k += 1
        self.memory = self._memory()

    def flight(self, failure: Failure) -> QuadrotorFlight:
        """Return the record as a flight."""
        return QuadrotorFlight(
            controller=self.control.name,
            failure=failure,
            record=np.array(self.record),
            lost=self.lost,
            timing=self.timing,
            agreement=self.control.agreement(),
        )

    def _sample(self, k: int) -> None:
        motion, starting = self.simulator.motion, round(TAKES_OFF / ATTITUDE_SAMPLE)
        if k == starting and not self.stale:
            self.control.reset(motion.attitude, motion.rates)
        if self.air.moves:
            self.simulator.blow(self.air.velocity[k])
        commands = self.control(self.sensing(motion, k), self.planned, k)
        self.limited += bool(((commands <= 0) | (commands >= self.most)).any())
        self.waiting.append(commands if k >= starting else np.zeros(ROTORS))
        if k % OUTER_EVERY == 0:
            row = self._row(motion, 100 * self.limited / OUTER_EVERY)
            self.record.append(row)
            self.limited, self.lost = 0, _lost(row, motion)
            if self.lost:
                return
        if k >= starting and not np.isfinite(commands).all():
            self.lost = NO_NUMBER
            return
        self.simulator.advance(self.waiting.popleft(), round(ATTITUDE_SAMPLE / STEP))

    def _row(self, motion: Motion, limited: float) -> list[float]:
        R = motion.attitude
        angles = np.rad2deg(
            [np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(min(max(R[2, 0], -1.0), 1.0)), np.arctan2(R[1, 0], R[0, 0])]
        )
        place = (*self.planned.position[self.k], *motion.position)
        return [self.k * ATTITUDE_SAMPLE, *place, *angles, *np.rad2deg(motion.rates), *self.simulator.thrusts, limited]


def _lost(row: list[float], motion: Motion) -> str:
    """Return why the vehicle is lost: it strayed, tipped over or came down. The text is empty if the vehicle is not lost."""
    if not np.isfinite(row).all():
        return "the simulation's numbers are no longer finite"
    if np.linalg.norm(np.subtract(row[4:7], row[1:4])) > LARGEST_DISTANCE:
        return f"it was more than {LARGEST_DISTANCE:g} m from its path"
    if motion.attitude[2, 2] < np.cos(np.deg2rad(LARGEST_TILT)):
        return f"it tilted by more than {LARGEST_TILT:g} deg"
    if row[0] > TAKES_OFF + CLIMBS and motion.position[2] < LEAST_HEIGHT:
        return "it hit the ground"
    return ""


GUSTS_SHARE = 0.1
"""Standard deviation of gusts along the wind divided by its mean. This is the value of MIL-F-8785C (3.7.3) for vertical gusts
near the ground; at a height of 10 m its value for gusts along the wind is 1.9 times as large."""
GUST_LENGTH = 68.0
"""Scale of gusts along the wind at a height of 10 m [m], from the same section."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Air:
    """The motion of the air.

    velocity  (K, 3) the velocity at the samples of the attitude [m/s]
    moves     whether the air moves at all
    """

    velocity: Array
    moves: bool

    @classmethod
    def drawn(cls, dispersion: Dispersion, samples: int) -> Air:
        """Return the constant wind of a dispersion."""
        away = np.deg2rad(dispersion.wind_from)
        towards = -np.array([np.cos(away), np.sin(away), 0.0])
        speed = _speed(dispersion.wind, samples, SEED + 2 * dispersion.number + 1)
        return cls(velocity=np.outer(speed, towards), moves=dispersion.wind > 0)

    def failing(self, failure: Failure, dispersion: Dispersion, samples: int) -> Air:
        """Return the air with the wind of a failure from the left."""
        speed = _speed(failure.wind, samples, SEED + 2 * dispersion.number)
        added = np.outer(speed, np.array([0.0, -1.0, 0.0]))
        return Air(velocity=self.velocity + added, moves=self.moves or failure.wind > 0)


def _speed(mean: float, samples: int, seed: int) -> Array:
    """Return the wind's speed at the samples [m/s]: Dryden's longitudinal gusts, an exact and stationary first-order process,
    around a mean."""
    if not mean:
        return np.zeros(samples)
    random = np.random.default_rng(seed)
    deviation, decay = GUSTS_SHARE * mean, np.exp(-ATTITUDE_SAMPLE * mean / GUST_LENGTH)
    gusts, gust = np.empty(samples), deviation * random.standard_normal()
    for k, drawn in enumerate(random.standard_normal(samples)):
        gusts[k] = gust
        gust = decay * gust + deviation * np.sqrt(1 - decay**2) * drawn
    return mean + gusts


SEED = 2010
"""The seed of the sensors' noise and of gusts."""


class Sensing:
    """The sensors, which turn motions into measurements sample by sample. Copies are independent."""

    def __init__(self, electronics: Electronics, samples: int, number: int) -> None:
        from scipy.spatial.transform import Rotation

        position, turn, velocity, rates = np.random.default_rng(SEED + 2 * number).standard_normal((4, samples, 3))
        self._turns = Rotation.from_rotvec(electronics.attitude_noise * turn).as_matrix()
        self._position, self._velocity = electronics.position_noise * position, electronics.velocity_noise * velocity
        self._rates = electronics.rate_noise * rates
        lag = electronics.rate_lag
        self._share = -float(np.expm1(-ATTITUDE_SAMPLE / lag)) if lag > 0 else None
        self._lagging = np.zeros(3)

    def __call__(self, motion: Motion, k: int) -> Motion:
        rates = motion.rates + self._rates[k]
        if self._share is not None:
            self._lagging = rates = self._lagging + self._share * (rates - self._lagging)
        position, velocity = motion.position + self._position[k], motion.velocity + self._velocity[k]
        return Motion(position, motion.attitude @ self._turns[k], velocity, rates)
