"""One flight of a quadrotor: a scheme on the moving vehicle, and a failure on the way."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from barbalat.flight.quadrotor.axes import ATTITUDE_SAMPLE, Axes, Electronics
from barbalat.flight.quadrotor.control import OUTER_EVERY, Control, Scheme
from barbalat.flight.quadrotor.failures import FAILS_AT, GUST_LENGTH, GUSTS_SHARE, Failure
from barbalat.flight.quadrotor.simulator import ROTORS, Motion, Simulator
from barbalat.flight.quadrotor.trajectory import CLIMBS, TAKES_OFF, Path, path
from barbalat.flight.quadrotor.vehicle import STANDING, STEP
from barbalat.flight.scene import attitudes
from barbalat.linear.largest import largest_whole
from barbalat.run.stepwise import Agreement
from barbalat.validate import Array

DURATION = 20.0
"""[s]."""
SEED = 2010
"""Of sensors' noise and of gusts, the same for every controller."""
COLUMNS = {
    "t": "s",
    **dict.fromkeys(("x_d", "y_d", "z_d", "x", "y", "z"), "m"),
    **dict.fromkeys(("roll", "pitch", "yaw"), "deg"),
    **dict.fromkeys(("p", "q", "r"), "deg/s"),
    **{f"thrust_{i + 1}": "N" for i in range(ROTORS)},
    "limited": "%",
}
"""What is recorded at each sample of position, in this order, with its unit; as it is, not as it is measured."""
FIGURES = {
    "rms_e": "m",
    "max_abs_e": "m",
    "sinks": "m",
    "tilt_max": "deg",
    "rotor_travel": "N/s",
    "rotor_max": "N",
    "limited": "%",
}
"""Of a flight, with units; e is the distance from where it should be, sinks how far it came below that, travel what the four
thrusts change by in a second on average, limited the share of the time in which some rotor is at an end of its range."""
FARTHEST, STEEPEST, LOWEST = 3.0, 85.0, STANDING + 0.02
"""[m] from its path, [deg] of tilt and [m] above the ground: beyond these the vehicle is lost."""


@dataclass(frozen=True, eq=False, kw_only=True)
class QuadrotorFlight:
    """What was flown.

    record     (K, 18), one row for each sample of position, see ``COLUMNS``; up to where the vehicle was lost
    lost       why it was lost, empty where it was not
    agreement  of the exported C of all axes with the simulated lists; None where those flew
    """

    controller: str
    failure: Failure
    record: Array
    lost: str
    agreement: Agreement | None = None

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
    def error(self) -> Array:
        """Distance from where it should be, at the samples [m]."""
        return np.asarray(np.linalg.norm(self.record[:, 4:7] - self.record[:, 1:4], axis=1))

    @property
    def attitude(self) -> Array:
        """(K, 3, 3), its columns the body's axes."""
        return attitudes(self.column("roll"), self.column("pitch"), self.column("yaw"))

    @property
    def tilt(self) -> Array:
        """Angle of its axis from the vertical, at the samples [deg]."""
        roll, pitch = np.deg2rad(self.column("roll")), np.deg2rad(self.column("pitch"))
        return np.rad2deg(np.arccos(np.clip(np.cos(roll) * np.cos(pitch), -1, 1)))

    @property
    def rms_error(self) -> float:
        """From the failure on [m]."""
        return float(np.sqrt(np.mean(self.error[self._after] ** 2)))

    @property
    def figures(self) -> dict[str, float | None]:
        """From the failure on, by the names of the JSON; null where the vehicle was lost."""
        after = self._after
        if self.lost or not after.any():
            return {"lost_at": self.lost_at, **dict.fromkeys(FIGURES)}
        thrusts = self.record[after, 13 : 13 + ROTORS]
        travel = np.abs(np.diff(thrusts, axis=0)).sum() / (ROTORS * np.ptp(self.column("t")[after]))
        sinks = (self.column("z_d") - self.column("z"))[after].max()
        values = (
            self.rms_error,
            self.error[after].max(),
            max(sinks, 0.0),
            self.tilt[after].max(),
            travel,
            thrusts.max(),
            self.column("limited")[after].mean(),
        )
        return {"lost_at": None, **dict(zip(FIGURES, map(float, values), strict=True))}

    @property
    def _after(self) -> Array:
        return np.asarray(self.column("t") >= self.failure.since)


def flown(axes: Axes, scheme: Scheme, failures: Sequence[Failure]) -> list[QuadrotorFlight]:
    """One scheme through the failures, in this process."""
    control = Control(axes, scheme)
    return [_fly(axes, control, failure) for failure in failures]


DELAY_STEP = 0.0025
"""[s] to which the largest delay is found: a sample of the attitude."""
COARSE, MOST = 8, 64
"""DELAY_STEPs from one trial to the next until the vehicle is lost, and the last of them."""


def delay_borne(axes: Axes, scheme: Scheme) -> float:
    """The largest added delay [s] with which the vehicle is kept, to DELAY_STEP: by trials upwards, then by bisection."""
    control = Control(axes, scheme)

    def kept(delay: int) -> bool:
        return not _fly(axes, control, Failure(name="delay", meaning="", delay=delay * DELAY_STEP)).lost

    return largest_whole(kept, stride=COARSE, most=MOST) * DELAY_STEP


def _fly(axes: Axes, control: Control, failure: Failure) -> QuadrotorFlight:
    simulator, T = Simulator(axes.hover.vehicle), ATTITUDE_SAMPLE
    samples, failing, starting = (round(seconds / T) for seconds in (DURATION, FAILS_AT, TAKES_OFF))
    planned, sensed, wind = path(T, samples), _sensed(axes.electronics, samples), _wind(failure, T, samples)
    waiting = deque([np.zeros(ROTORS)] * round(axes.electronics.delay / T))
    record: list[list[float]] = []
    limited, lost = 0, ""
    control.reset(np.eye(3), np.zeros(3))
    for k in range(samples):
        motion = simulator.motion
        if k == starting and not failure.stale:
            control.reset(motion.attitude, motion.rates)
        if k == failing:
            _fail(simulator, failure)
            waiting.extendleft([waiting[0]] * round(failure.delay / T))
        if k >= failing and failure.wind:
            simulator.blow(np.array([0.0, -wind[k], 0.0]))
        commands = control(sensed(motion, k), planned, k)
        limited += bool(((commands <= 0) | (commands >= axes.hover.vehicle.thrust)).any())
        waiting.append(commands if k >= starting else np.zeros(ROTORS))
        if k % OUTER_EVERY == 0:
            record.append(_row(k * T, planned, k, motion, simulator.thrusts, 100 * limited / OUTER_EVERY))
            limited = 0
            lost = _lost(record[-1], motion)
            if lost:
                break
        simulator.advance(waiting.popleft(), round(T / STEP))
    return QuadrotorFlight(
        controller=control.name, failure=failure, record=np.array(record), lost=lost, agreement=control.agreement()
    )


def _fail(simulator: Simulator, failure: Failure) -> None:
    if failure.slung is not None:
        simulator.hook_on(failure.slung)
    if failure.motor_lag is not None:
        simulator.slow_down(failure.motor_lag)
    simulator.weaken(0, failure.effectiveness)


def _sensed(electronics: Electronics, samples: int) -> Callable[[Motion, int], Motion]:
    """What is measured of a motion at a sample."""
    from scipy.spatial.transform import Rotation

    random = np.random.default_rng(SEED)
    position, turn, velocity, rates = random.standard_normal((4, samples, 3))
    turns = Rotation.from_rotvec(electronics.attitude_noise * turn).as_matrix()
    added = electronics.position_noise * position, electronics.velocity_noise * velocity, electronics.rate_noise * rates

    def sensed(motion: Motion, k: int) -> Motion:
        shifted = motion.position + added[0][k], motion.velocity + added[1][k], motion.rates + added[2][k]
        return Motion(shifted[0], motion.attitude @ turns[k], shifted[1], shifted[2])

    return sensed


def _wind(failure: Failure, T: float, samples: int) -> Array:
    """Its speed [m/s] at the samples: Dryden's longitudinal gusts, a first-order process, around a mean; exact and stationary."""
    if not failure.wind:
        return np.zeros(samples)
    random = np.random.default_rng(SEED)
    deviation, decay = GUSTS_SHARE * failure.wind, np.exp(-T * failure.wind / GUST_LENGTH)
    gusts, gust = np.empty(samples), deviation * random.standard_normal()
    for k, drawn in enumerate(random.standard_normal(samples)):
        gusts[k] = gust
        gust = decay * gust + deviation * np.sqrt(1 - decay**2) * drawn
    return failure.wind + gusts


def _row(t: float, planned: Path, k: int, motion: Motion, thrusts: Array, limited: float) -> list[float]:
    R = motion.attitude
    angles = np.rad2deg([np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(min(max(R[2, 0], -1.0), 1.0)), np.arctan2(R[1, 0], R[0, 0])])
    return [t, *planned.position[k], *motion.position, *angles, *np.rad2deg(motion.rates), *thrusts, limited]


def _lost(row: list[float], motion: Motion) -> str:
    """Where the vehicle strays, tips over, or comes down."""
    if not np.isfinite(row).all():
        return "the simulation's numbers are no longer finite"
    if np.linalg.norm(np.subtract(row[4:7], row[1:4])) > FARTHEST:
        return f"it was more than {FARTHEST:g} m from where it should be"
    if motion.attitude[2, 2] < np.cos(np.deg2rad(STEEPEST)):
        return f"it tilted by more than {STEEPEST:g} deg"
    if row[0] > TAKES_OFF + CLIMBS and motion.position[2] < LOWEST:
        return "it came down to the ground"
    return ""
