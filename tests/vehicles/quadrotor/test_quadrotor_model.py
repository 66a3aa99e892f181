"""The quadrotor's flight model and its geometric controller, compared with closed formulas and theory."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

mujoco = pytest.importorskip("mujoco", reason="the extra flight is not installed: ./dev flight installs it")

from barbalat import InputError  # noqa: E402
from barbalat.vehicles.quadrotor.axes import Axes  # noqa: E402
from barbalat.vehicles.quadrotor.body import PLACES, SPINS, STANDING, STEP, Quadrotor, SlungMass  # noqa: E402
from barbalat.vehicles.quadrotor.geometry import (  # noqa: E402
    AttitudeCommand,
    allocated,
    attitude_errors,
    carried,
    commanded_attitude,
    turned,
)
from barbalat.vehicles.quadrotor.hover import hovering  # noqa: E402
from barbalat.vehicles.quadrotor.simulator import Motion, Simulator  # noqa: E402
from barbalat.vehicles.quadrotor.trajectory import CLIMBS, HALF_LENGTH, HALF_WIDTH, HEIGHT, PERIOD, path  # noqa: E402

VEHICLE = Quadrotor()
LEVEL = Motion(np.array([0.0, 0.0, 5.0]), np.eye(3), np.zeros(3), np.zeros(3))


@pytest.fixture(scope="module")
def hover():
    return hovering(VEHICLE)


def test_it_falls_as_in_a_vacuum_at_first():
    """The drag of MuJoCo's box is limited by the density of 1.3 kg/m^3 times its area, which is a tenth of a newton after 0.2 s
    at 2 m/s."""
    simulator = Simulator(VEHICLE)
    simulator.put(LEVEL, np.zeros(4))
    simulator.advance(np.zeros(4), round(0.2 / STEP))
    motion = simulator.motion
    assert motion.velocity[2] == pytest.approx(-9.81 * 0.2, rel=0.03)
    assert motion.position[2] - 5 == pytest.approx(-9.81 * 0.2**2 / 2, rel=0.03)
    assert abs(motion.velocity[2]) < 9.81 * 0.2


def test_it_hovers_where_four_thrusts_carry_its_weight(hover):
    np.testing.assert_allclose(hover.thrusts, VEHICLE.mass * 9.81 / 4, rtol=1e-12)
    simulator = Simulator(VEHICLE)
    simulator.put(LEVEL, hover.thrusts)
    simulator.advance(hover.thrusts, round(5 / STEP))
    np.testing.assert_allclose(simulator.motion.position, LEVEL.position, atol=1e-9)


def test_the_linear_model_is_the_rigid_body_s_by_hand(hover):
    m, (J_x, J_y, J_z), g = VEHICLE.mass, VEHICLE.inertia, 9.81
    by_hand = np.array(
        [[1 / m, left * VEHICLE.reach / J_x, -forward * VEHICLE.reach / J_y, spin * VEHICLE.torque / J_z]
         for (forward, left), spin in zip(PLACES, SPINS, strict=True)]
    ).T  # fmt: skip
    np.testing.assert_allclose(hover.effect, by_hand, rtol=1e-6)
    A = np.zeros((12, 12))
    A[:6, 6:] = np.eye(6)
    A[6, 4], A[7, 3] = g, -g  # nose down flies forward, left side down flies left
    np.testing.assert_allclose(hover.A, A, atol=1e-5)  # drag's differences are of second order: DIFFERENCE times 0.1 kg/m
    np.testing.assert_allclose(hover.mixer @ hover.effect, np.eye(4), atol=1e-12)


@pytest.mark.parametrize("lag", [0.02, 0.07])
def test_a_step_of_thrust_is_a_motor_s_exponential(lag):
    """RK4's error is (STEP/lag)^5/120 in each step, 3e-7 for the fastest motor."""
    simulator = Simulator(VEHICLE)
    simulator.put(LEVEL, np.zeros(4))
    simulator.slow_down(lag)
    t, found = STEP * np.arange(1, 81), []
    for _ in t:
        simulator.advance(np.full(4, 3.0))
        found.append(simulator.data.act.copy())
    np.testing.assert_allclose(found, (3 * -np.expm1(-t / lag))[:, None] * np.ones(4), rtol=1e-5)


def test_rotors_end_at_nothing_and_at_their_most():
    simulator = Simulator(VEHICLE)
    for asked, given in ((1e3, VEHICLE.thrust), (-1e3, 0.0)):
        simulator.put(LEVEL, np.full(4, 2.0))
        simulator.advance(np.full(4, asked), round(1 / STEP))
        np.testing.assert_allclose(simulator.thrusts, given, atol=1e-6)


def spinning(integrator, step):
    """The energy and angular momentum of a body after 10 s of tumbling in a vacuum without weight, relative to their initial
    values."""
    simulator = Simulator(VEHICLE, integrator=integrator, step=step)
    simulator.model.opt.density, simulator.model.opt.gravity[:] = 0.0, 0.0
    simulator.put(LEVEL._replace(rates=np.array([6.0, 4.0, 2.0])), np.zeros(4))
    J = np.asarray(VEHICLE.inertia)

    def momentum():
        motion = simulator.motion
        return motion.attitude @ (J * motion.rates)

    energy, first = simulator.energy, momentum()
    simulator.advance(np.zeros(4), round(10 / step))
    return abs(simulator.energy / energy - 1), np.linalg.norm(momentum() - first) / np.linalg.norm(first)


def test_what_is_conserved_is_by_the_integrator_that_is_set_and_not_by_the_default():
    kept = spinning("RK4", STEP)
    assert max(kept) < 1e-6
    assert max(spinning("RK4", STEP / 2)) < max(kept) / 8  # of fourth order
    assert max(spinning("Euler", STEP)) > 1e3 * max(kept)


def test_a_slung_mass_hangs_still_below_a_vehicle_that_hovers():
    """The mass is attached at the centre, so the thrust carries five quarters of the weight and nothing swings."""
    slung, simulator = SlungMass(offset=0.0), Simulator(VEHICLE)
    lifting = np.full(4, (VEHICLE.mass + slung.mass) * 9.81 / 4)
    leaning = Rotation.from_euler("xy", [8, -5], degrees=True).as_matrix()
    simulator.put(LEVEL._replace(attitude=leaning, velocity=np.array([1.0, 0.0, 0.0])), lifting)
    simulator.hook_on(slung)
    mass = simulator.data.body("slung")
    hung = mass.xipos - simulator.data.body("vehicle").xpos
    np.testing.assert_allclose(hung, [0, 0, -slung.cable], atol=1e-12)  # vertical, however the vehicle is tilted
    np.testing.assert_allclose(simulator.motion.velocity, [1, 0, 0], atol=1e-12)
    simulator.put(LEVEL, lifting)
    simulator.data.qpos[7:11], simulator.data.qvel[:] = [1, 0, 0, 0], 0
    simulator.advance(lifting, round(2 / STEP))
    np.testing.assert_allclose(simulator.motion.position, LEVEL.position, atol=1e-6)


def test_half_the_step_moves_it_alike(hover):
    ends = []
    for step in (STEP, STEP / 2):
        simulator = Simulator(VEHICLE, step=step)
        simulator.put(LEVEL._replace(rates=np.array([1.0, -2.0, 0.5])), hover.thrusts)
        simulator.advance(hover.thrusts + np.array([0.01, -0.01, 0.02, 0.0]), round(1 / step))
        ends.append(np.concatenate([simulator.motion.position, simulator.motion.rates]))
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-5, atol=1e-6)


def test_the_attitude_s_error_decays_as_the_theory_says(hover):
    """According to Lee, Leok and McClamroch, with the controller's moments, e_R and e_Omega satisfy e'' + k_Omega e' + k_R e = 0
    near zero.

    From 5 deg the error equals the error of the linear loop up to terms of second order. From 170 deg Psi = tr(I - R_d'R)/2 never
    grows after a start with zero rates, in the sublevel set of the proof. Here the body moves by Euler's equations.
    """
    axes = Axes(hover=hover)
    gains = np.array([axis.gain for axis in axes.attitude])
    R_d, J = Rotation.from_euler("zyx", [0.3, -0.2, 0.1]).as_matrix(), np.asarray(VEHICLE.inertia)

    def flown(turn, seconds, h=1e-3):
        command = AttitudeCommand(R_d, np.zeros(3), np.zeros(3))
        R, Omega, errors = R_d @ Rotation.from_rotvec(turn).as_matrix(), np.zeros(3), []
        for _ in range(round(seconds / h)):
            e = attitude_errors(R, Omega, command)
            errors.append((e, 0.5 * np.trace(np.eye(3) - R_d.T @ R)))
            moment = J * (-(gains * e).sum(axis=1) + carried(R, Omega, command)) + np.cross(Omega, J * Omega)
            acceleration = (moment - np.cross(Omega, J * Omega)) / J
            R, Omega = turned(R, h * (Omega + 0.5 * h * acceleration)), Omega + h * acceleration
        return errors

    start = np.deg2rad([5.0, -3.0, 2.0])
    found = flown(start, 0.4)
    for axis, gain in enumerate(gains):
        linear = expm(0.4 * np.array([[0, 1], [-gain[0], -gain[1]]])) @ [start[axis], 0.0]
        assert found[-1][0][axis, 0] == pytest.approx(linear[0], abs=0.02 * np.abs(start).max())
    large = flown(np.deg2rad(170) * np.array([0.6, 0.8, 0.0]), 3.0)
    assert large[0][1] > 1.9  # beyond the range of linear control; the largest value is 2
    assert large[-1][1] < 1e-4
    V = [0.5 * (e[:, 1] ** 2).sum() + (gains[:2, 0].mean()) * psi for e, psi in large]  # k_R of roll and pitch are equal
    assert max(np.diff(V)) < 1e-3 * V[0]


def test_geometry_is_that_of_rotations():
    random = np.random.default_rng(1)
    for _ in range(20):
        R = Rotation.random(random_state=random.integers(1 << 30)).as_matrix()
        angles = 0.01 * random.standard_normal(3)
        np.testing.assert_allclose(turned(R, angles), R @ Rotation.from_rotvec(angles).as_matrix(), atol=1e-9)
        wanted = random.standard_normal(3) + np.array([0, 0, 9.81])
        R_d = commanded_attitude(wanted)
        np.testing.assert_allclose(R_d.T @ R_d, np.eye(3), atol=1e-12)
        assert np.linalg.det(R_d) == pytest.approx(1)
        np.testing.assert_allclose(R_d[:, 2], wanted / np.linalg.norm(wanted), atol=1e-12)
        forward = np.array([1.0, 0, 0]) - R_d[0, 2] * R_d[:, 2]  # the paper's projection
        np.testing.assert_allclose(R_d[:, 0], forward / np.linalg.norm(forward), atol=1e-12)


def test_where_rotors_end_the_moments_are_kept_and_the_thrust_gives_way(hover):
    axes, random = Axes(hover=hover), np.random.default_rng(2)
    most = 2 * np.array([axis.limit for axis in axes.attitude])
    for _ in range(200):
        turning, up = most * random.uniform(-1, 1, 3), random.uniform(-5, 40)
        thrusts = allocated(hover.mixer, hover.thrusts, VEHICLE.thrust, up, turning)
        assert ((thrusts >= 0) & (thrusts <= VEHICLE.thrust)).all()
        given = hover.effect @ thrusts
        np.testing.assert_allclose(given[1:], turning, atol=1e-9)
    easy = allocated(hover.mixer, hover.thrusts, VEHICLE.thrust, 12.0, 0.1 * most)
    assert hover.effect[0] @ easy == pytest.approx(12.0)


def test_the_path_s_derivatives_are_those_of_its_position():
    T = 2e-3
    found = path(T, 7500)
    for low, high in ((found.position, found.velocity), (found.velocity, found.acceleration)):
        np.testing.assert_allclose(
            (low[2:] - low[:-2]) / (2 * T), high[1:-1], atol=1e-3
        )  # T^2/6 of a third derivative of some 100
    assert found.position[0] == pytest.approx([0, 0, STANDING])
    around = 2 * np.pi / PERIOD
    steepest = 35 / 16  # of 35 s^4 - 84 s^5 + ...
    fastest = [HALF_LENGTH * around, 2 * HALF_WIDTH * around, steepest * (HEIGHT - STANDING) / CLIMBS]
    assert np.abs(found.velocity).max(axis=0) == pytest.approx(fastest, rel=1e-3)


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ({"mass": 0}, "mass"),
        ({"motor_lag": -1}, "motor_lag"),
        ({"inertia": (1, 1, 3)}, "inertia"),
        ({"thrust": 2}, "thrust must lift"),
    ],
)
def test_a_vehicle_says_what_is_wrong_with_it(given, name):
    with pytest.raises(InputError, match=name):
        Quadrotor(**given)


def test_one_that_is_too_heavy_for_one_rotor_can_t_hover():
    beside = SimpleNamespace(**dataclasses.asdict(VEHICLE) | {"thrust": 2.0})
    with pytest.raises(InputError, match="can't hover"):
        hovering(beside)


def test_numbers_that_are_none_stay_so_and_leave_no_file(tmp_path, monkeypatch):
    """MuJoCo itself would reset the vehicle to its initial position and write MUJOCO_LOG.TXT into the user's folder."""
    monkeypatch.chdir(tmp_path)
    simulator = Simulator(Quadrotor())
    simulator.data.qvel[2] = 1e11  # the drag, which is quadratic in it, overflows
    simulator.advance(np.full(4, np.nan), 3)
    assert np.isnan(simulator.motion.position).any()
    assert list(tmp_path.iterdir()) == []
