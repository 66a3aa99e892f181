"""A quadrotor of one kilogram: its parameters, and its model in MuJoCo's file format."""

from __future__ import annotations

from dataclasses import dataclass

from barbalat import validate
from barbalat.validate import InputError, Vector

INTEGRATOR = "RK4"
"""The integrator. MuJoCo's default, Euler steps, lets the energy drift; a test compares both."""
STEP = 1 / 400
"""The step [s], which is the sample time of the attitude controllers. A test shows that half this step gives the same motion."""
AIR_DENSITY = 1.225
"""Density of air [kg/m^3]. MuJoCo models the drag of a box with the mass and inertia of the body, quadratic in the airspeed."""
SPINS = (1, -1, 1, -1)
"""Sense of the rotors' drag torque about the upward axis, in the order front left, rear left, rear right, front right."""
PLACES = ((1, 1), (-1, 1), (-1, -1), (1, -1))
"""Positions of the rotors in the same order, forward and left in units of ``reach``."""
LEGS = 0.08
"""Distance of the feet below the centre of gravity [m]."""
FOOT = 0.02
"""Radius of a foot [m]."""
SLOPE = 5.0
"""Slope of the ground at the start [deg], because a start is never level."""
STANDING = LEGS + FOOT
"""Height of the centre of gravity on the ground [m]."""


@dataclass(frozen=True, kw_only=True)
class Quadrotor:
    """Four rotors at the corners of a square.

    mass       the mass [kg]
    inertia    the moments of inertia about the forward, left and upward axes [kg m^2]
    reach      distance of a rotor from the centre, both forward or back and left or right [m]
    thrust     the largest thrust of a rotor [N]; the smallest is zero
    torque     drag torque of a rotor divided by its thrust [m]
    motor_lag  the first-order lag of the thrust [s]; identified values are between 0.02 and 0.07 s
    centre     distance of the centre of gravity forward and left of the middle of the rotors [m]
    """

    mass: float = 1.0
    inertia: Vector = (0.0105, 0.0095, 0.0180)
    reach: float = 0.12
    thrust: float = 6.0
    torque: float = 0.016
    motor_lag: float = 0.035
    centre: Vector = (0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("mass", "reach", "thrust", "torque", "motor_lag"):
            validate.freeze(self, **{name: validate.positive(name, self.__dict__[name])})
        inertia = validate.vector("inertia", self.inertia, 3)
        if not (inertia > 0).all() or 2 * inertia.max() > inertia.sum():
            raise InputError(f"inertia must be three numbers, none above the sum of the others, got {validate.show(inertia)}")
        validate.freeze(self, inertia=inertia, centre=validate.vector("centre", self.centre, 2))
        if 4 * self.thrust <= self.mass * GRAVITY:
            raise InputError(f"thrust must lift {self.mass:g} kg with four rotors, got {self.thrust:g} N")


GRAVITY = 9.81
"""[m/s^2]."""


@dataclass(frozen=True, kw_only=True)
class SlungMass:
    """A mass on a taut cable, modelled as a massless rod on a ball joint.

    mass    the mass [kg]
    cable   the length of the cable [m]
    offset  the hook's distance from the centre, the same forward and left [m]
    """

    mass: float = 0.25
    cable: float = 0.5
    offset: float = 0.03


def mjcf(vehicle: Quadrotor, *, slung: SlungMass | None = None, step: float = STEP, integrator: str = INTEGRATOR) -> str:
    """Return the model in MuJoCo's format. It is written entirely here, and its axes are forward, left and up.

    NaNs are kept, because MuJoCo would otherwise reset the vehicle to the ground.
    """
    places = [(vehicle.reach * forward, vehicle.reach * left) for forward, left in PLACES]
    sites = "".join(f'<site name="rotor-{i}" pos="{x!r} {y!r} 0"/>' for i, (x, y) in enumerate(places))
    feet = "".join(
        f'<geom name="foot-{i}" type="sphere" size="{FOOT}" mass="0" pos="{x!r} {y!r} {-LEGS}"/>'
        for i, (x, y) in enumerate(places)
    )
    motors = "".join(
        f'<general name="rotor-{i}" site="rotor-{i}" gear="0 0 1 0 0 {spin * vehicle.torque!r}" dyntype="filter" '
        f'dynprm="{vehicle.motor_lag!r}" ctrllimited="true" ctrlrange="0 {vehicle.thrust!r}"/>'
        for i, spin in enumerate(SPINS)
    )
    hung = "" if slung is None else _hung(slung)
    inertia = " ".join(repr(float(one)) for one in vehicle.inertia)
    centre = " ".join(repr(float(one)) for one in (*vehicle.centre, 0.0))
    return f"""<mujoco model="quadrotor">
<option timestep="{step!r}" integrator="{integrator}" density="{AIR_DENSITY}" gravity="0 0 {-GRAVITY}">
<flag autoreset="disable"/></option>
<worldbody><geom name="ground" type="plane" size="50 50 1" euler="{SLOPE} 0 0"/>
<body name="vehicle" pos="0 0 {STANDING}" euler="{SLOPE} 0 0"><freejoint/>
<inertial pos="{centre}" mass="{vehicle.mass!r}" diaginertia="{inertia}"/>{sites}{feet}{hung}</body>
</worldbody>
<actuator>{motors}</actuator>
</mujoco>"""


SWING_DAMPING = 1e-3
"""Damping of the hook [N m s]. A mass on a cable of half a metre loses a fifth of its height in ten swings."""


def _hung(slung: SlungMass) -> str:
    """Return the slung mass in MuJoCo's format, a ball of 4 cm. Its own inertia is a hundredth of that due to the cable."""
    ball = 0.4 * slung.mass * 0.04**2
    return (
        f'<body name="slung" pos="{slung.offset!r} {slung.offset!r} 0"><joint name="hook" type="ball" damping="{SWING_DAMPING}"/>'
        f'<inertial pos="0 0 {-slung.cable!r}" mass="{slung.mass!r}" diaginertia="{ball!r} {ball!r} {ball!r}"/></body>'
    )
