"""A rigid aircraft in JSBSim, whose state can be set, whose rates can be read, and whose motion can be stepped. Units are feet
and pounds, as in its tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barbalat import validate
from barbalat.validate import Array, InputError
from barbalat.vehicles.f16 import model as f16

if TYPE_CHECKING:
    from jsbsim import FGFDMExec, FGPropertyNode

RATES_BY, POSITIONS_BY = 4, 4
"""JSBSim's codes for its integrators: Adams-Bashforth of order 3, for both rotation and translation.

By default JSBSim uses Euler steps for the rotation. A test shows that results with half the step agree."""
INTEGRATOR = "Adams-Bashforth of order 3"
STEP = 1 / 400
"""The simulator's step [s]. There are four steps per sample at 100 Hz."""


@dataclass(frozen=True)
class FlightCondition:
    """The condition at which level flight is trimmed.

    altitude  above mean sea level [ft]
    mach      true airspeed divided by the speed of sound at that altitude
    """

    altitude: float = 10_013.0
    mach: float = 0.525

    def __post_init__(self) -> None:
        validate.freeze(
            self, altitude=validate.not_negative("altitude", self.altitude), mach=validate.positive("mach", self.mach)
        )
        if self.altitude > HIGHEST:
            raise InputError(f"altitude must be at most {HIGHEST:g} ft, where the engine's tables end, got {self.altitude:g}")
        if self.mach > FASTEST:
            raise InputError(f"mach must be at most {FASTEST:g}, the fastest that an F-16 flies, got {self.mach:g}")

    def __str__(self) -> str:
        return f"{self.altitude:g} ft, Mach {self.mach:g}"


HIGHEST, FASTEST = 50_000.0, 2.0
CONDITIONS = (
    FlightCondition(),
    FlightCondition(altitude=0.0, mach=0.45),
    FlightCondition(altitude=30_000.0, mach=0.8),
)
"""Three conditions for comparison. The first is that of NASA/TM-2015-218675, the second is 502 ft/s at sea level, as in Stevens
and Lewis, and the third is a high and fast condition, at which the airframe is unstable."""
ABOVE_GROUND = 50_000.0
"""Height above the terrain [ft]. It keeps wheels and wings clear of the terrain and of ground effect, even at sea level."""


class Motion(NamedTuple):
    """The state of a rigid aircraft without its position [ft/s], [rad], [rad/s]."""

    speed: float
    alpha: float
    theta: float
    q: float
    beta: float = 0.0
    phi: float = 0.0
    p: float = 0.0
    r: float = 0.0


PROPERTIES = {
    "speed": "velocities/vt-fps",
    "alpha": "aero/alpha-rad",
    "theta": "attitude/theta-rad",
    "q": "velocities/q-rad_sec",
    "beta": "aero/beta-rad",
    "phi": "attitude/phi-rad",
    "p": "velocities/p-rad_sec",
    "r": "velocities/r-rad_sec",
}
"""JSBSim's names for the entries of a motion."""
DEGREES = 180 / np.pi
"""Degrees per radian."""


class Surfaces(NamedTuple):
    """The deflections that the tables read [rad]."""

    elevator: float
    aileron: float = 0.0
    rudder: float = 0.0


class Airframe:
    """The F-16 at a condition. JSBSim's data are global, so a process can have only one airframe (see ``isolated``)."""

    def __init__(self, condition: FlightCondition, step: float = STEP) -> None:
        self.condition, self.step = condition, step
        self.fdm: FGFDMExec = f16.load(step)
        for rate in ("rotational", "translational"):
            self.fdm[f"simulation/integrator/rate/{rate}"] = RATES_BY
            self.fdm[f"simulation/integrator/position/{rate}"] = POSITIONS_BY
        self.fdm["ic/terrain-elevation-ft"] = condition.altitude - ABOVE_GROUND
        self.fdm["ic/h-sl-ft"] = condition.altitude
        self.fdm["ic/mach"] = condition.mach
        self.speed = float(self.fdm["ic/vt-fps"])

    def put(self, motion: Motion, surfaces: Surfaces, throttle: float) -> None:
        """Set the state at t = 0, with an engine that has settled at its throttle."""
        fdm = self.fdm
        fdm["ic/h-sl-ft"] = self.condition.altitude
        fdm["ic/vt-fps"] = motion.speed
        fdm["ic/alpha-rad"], fdm["ic/beta-rad"] = motion.alpha, motion.beta  # first: they keep the climb and turn the attitude
        fdm["ic/phi-rad"], fdm["ic/theta-rad"] = motion.phi, motion.theta
        for name in ("p", "q", "r"):
            fdm[f"ic/{name}-rad_sec"] = getattr(motion, name)
        self.move(surfaces)
        fdm["fcs/throttle-cmd-norm"] = throttle
        fdm.run_ic()
        fdm["propulsion/set-running"] = -1  # start all engines, at the engine speed for this throttle
        fdm.run_ic()

    def move(self, surfaces: Surfaces) -> None:
        """Set the deflections that the aerodynamic tables read."""
        for name, value in zip(f16.SURFACES, surfaces, strict=True):
            self.fdm[f"surfaces/{name}-rad"] = value

    def surface(self, place: int) -> FGPropertyNode:
        """Return a setter for one deflection that the aerodynamic tables read [rad], for repeated use."""
        return self._node(f"surfaces/{f16.SURFACES[place]}-rad")

    def seeing(self, states: Iterable[str], trimmed: Sequence[float]) -> Callable[[], list[float]]:
        """Return a function that reads these angles and rates, minus their trim values [deg, deg/s]."""
        read = [(self._node(PROPERTIES[name]).get_double_value, at) for name, at in zip(states, trimmed, strict=True)]
        return lambda: [DEGREES * value() - at for value, at in read]

    def _node(self, name: str) -> FGPropertyNode:
        """Return a property of JSBSim for repeated reading or setting."""
        node = self.fdm.get_property_manager().get_node(name)
        if node is None:
            raise InputError(f"JSBSim's F-16 has no property {name}: is a different version of JSBSim installed?")
        return node

    def blow(self, down: float, east: float = 0.0) -> None:
        """Set the velocity of the air [ft/s]. The aircraft flies north."""
        self.fdm["atmosphere/gust-down-fps"] = down
        self.fdm["atmosphere/gust-east-fps"] = east

    def shift_ballast(self, aft: float, right: float = 0.0) -> None:
        """Move ``f16.BALLAST_LB`` by this distance [in]."""
        for axis, way in (("X", aft), ("Y", right)):
            place = f"inertia/pointmass-location-{axis}-inches[{f16.BALLAST}]"
            self.fdm[place] = self.fdm[place] + way

    def load(self, pounds: float) -> None:
        """Add this weight at the ballast's position [lb]."""
        place = f"inertia/pointmass-weight-lbs[{f16.BALLAST}]"
        self.fdm[place] = self.fdm[place] + pounds

    def scale(self, coefficient: str, factor: float) -> None:
        """Multiply one of ``f16.SCALED`` by this factor."""
        self.fdm[f"scale/{coefficient}"] = factor

    @property
    def motion(self) -> Motion:
        """The current motion."""
        return Motion(*(self.fdm[PROPERTIES[name]] for name in Motion._fields))

    @property
    def load_factor(self) -> float:
        """The load factor n_z at the centre of gravity, which is 1 in level flight [g]."""
        return float(self.fdm["accelerations/Nz"])

    def angles(self, states: Iterable[str]) -> Array:
        """Return the selected angles and rates of the motion [deg, deg/s]."""
        return DEGREES * np.array([self.fdm[PROPERTIES[name]] for name in states])

    @property
    def altitude(self) -> float:
        """The altitude above mean sea level [ft]."""
        return float(self.fdm["position/h-sl-ft"])

    @property
    def heading(self) -> float:
        """The heading relative to the initial one [deg], from -180 to 180, positive to the right."""
        return float(np.remainder(DEGREES * self.fdm["attitude/psi-rad"] + 180, 360) - 180)

    @property
    def ground_velocity(self) -> tuple[float, float]:
        """The velocity north, which is the initial direction of flight, and east [ft/s]."""
        return float(self.fdm["velocities/v-north-fps"]), float(self.fdm["velocities/v-east-fps"])

    @property
    def rates(self) -> Array:
        """The time derivative of the motion (8,)."""
        fdm = self.fdm
        u, v, w = (fdm[f"velocities/{axis}-fps"] for axis in "uvw")
        u_dot, v_dot, w_dot = (fdm[f"accelerations/{axis}dot-ft_sec2"] for axis in "uvw")
        p_dot, q_dot, r_dot = (fdm[f"accelerations/{axis}dot-rad_sec2"] for axis in "pqr")
        along = u * u + w * w
        speed = np.sqrt(along + v * v)
        speed_dot = (u * u_dot + v * v_dot + w * w_dot) / speed
        alpha_dot = (u * w_dot - w * u_dot) / along
        beta_dot = (v_dot * speed - v * speed_dot) / (speed * np.sqrt(along))
        theta_dot, phi_dot = fdm["velocities/thetadot-rad_sec"], fdm["velocities/phidot-rad_sec"]
        return np.array([speed_dot, alpha_dot, theta_dot, q_dot, beta_dot, phi_dot, p_dot, r_dot])
