"""The margins over the ranges of physical parameters are the margins of the real plants, as loops built by hand show."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_are

from barbalat import certify
from barbalat.cases.load import parse_case
from barbalat.certificates.linear_loops.from_sample_to_sample import linearised
from barbalat.certificates.linear_loops.ideal import fast_adaptation, fast_adaptation_on
from barbalat.certificates.linear_loops.margin_values import with_dynamics
from barbalat.certificates.linear_loops.over_ranges import frozen_controller, plants_of
from barbalat.certificates.schemes.sampled_loop import linear_because
from barbalat.certificates.summary import five
from barbalat.linear.systems import input_filter
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.truth import Truth

PENDULUM = """
name = "inverted pendulum"
[parameters]
J = { value = 1.0, between = [0.7, 1.4] }
g = { value = 9.0, between = RANGE }
[plant]
A = [[0, 1], ["g/J", 0]]
b = [0, "1/J"]
[baseline]
kind = "state"
K = [13.0, 6.0]
[reference_model]
follow = "x_1"
[reference]
kind = "step"
amplitude = 0.1
[simulation]
t_end = 1.0
dt = 1e-3
[[controller]]
name = "continuous"
scheme = "baseline"
[[controller]]
name = "sampled"
scheme = "baseline"
sample_time = 1e-3
"""
"""The closed loop has the polynomial J s^2 + 6 s + 13 - g and is stable for g < 13 and every J. A box of theta and omega,
however, also combines the largest g/J with the smallest 13/J."""


def certified(text):
    case = parse_case(text)
    found = certify(case.problem, case.controllers, case.simulation)
    return {name: (one, one.values["margins_over_known_set"][0]) for name, one in found.items()}


def delay_margin(J, g):
    """The delay margin of (6 s + 13)/(J s^2 - g) at its crossover, by hand: atan(6 w/13)/w with (J w^2 + g)^2 = 36 w^2 + 169."""
    (square,) = (root.real for root in np.roots([J**2, 2 * J * g - 36.0, g**2 - 169.0]) if root.real > 0)
    return np.arctan(6 * np.sqrt(square) / 13) / np.sqrt(square)


def margin_line(certificate):
    (said,) = (line.text for line in five(None_column(), certificate, None) if line.label == "margin")
    return said


class None_column:
    cells: dict = {}  # noqa: RUF012


@pytest.mark.parametrize(("name", "hold"), [("continuous", 0.0), ("sampled", 0.5e-3)])
def test_a_box_with_unstable_points_is_not_an_unstable_plant(name, hold):
    """Over J and g the margin is smallest at the corner J = 0.7, g = 10. The hold of the sampled loop delays by half a sample
    period."""
    certificate, found = certified(PENDULUM.replace("RANGE", "[8.0, 10.0]"))[name]
    least = min(delay_margin(J, g) for J in (0.7, 1.4) for g in (8.0, 10.0))
    assert found["delay_margin"]["value"] == pytest.approx(least - hold, abs=1e-5)
    at = found["delay_margin"]["parameters"]
    assert delay_margin(**at) == pytest.approx(least)
    assert found["over"] == "the parameters' ranges" and "unstable_at" not in found
    assert f"in the ranges, at J = {at['J']:g}, g = {at['g']:g}" in margin_line(certificate)


@pytest.mark.parametrize("name", ["continuous", "sampled"])
def test_an_unstable_plant_is_named_by_its_parameters(name):
    certificate, found = certified(PENDULUM.replace("RANGE", "[5.0, 15.0]"))[name]
    assert found["unstable_at_parameters"]["g"] > 13
    (said,) = (note for note in certificate.notes if "unstable" in note)
    assert f"g = {found['unstable_at_parameters']['g']:.4g}" in said
    assert "unstable in the ranges, at J = " in margin_line(certificate)


BELT = """
name = "belt"
[parameters]
m = { value = 0.75, between = [0.0, 1.5] }
k = { value = 60.0, between = [30.0, 90.0] }
tau = { value = 0.004, between = [0.002, 0.008] }
d = { value = 0.008, between = [0.006, 0.012] }
[plant]
A = [[0, 1, 0, 0], ["-k/0.08", "-0.3/0.08", "k/0.08", 0], [0, 0, 0, 1], ["k/(0.03 + m*0.0625)", 0, "-k/(0.03 + m*0.0625)", -2.0]]
b = [0, 6.0, 0, 0]
PLANT
[plant.input]
delay = "d"
actuator = { num = [1.0], den = ["tau", 1.0] }
[sensor]
lag = "tau/2"
OBSERVER
[baseline]
kind = "lqr"
Q = [3.0, 0.01, 30.0, 0.02]
R = 1.0
[reference_model]
follow = "x_1"
[reference]
kind = "step"
amplitude = 0.1
[simulation]
t_end = 1.0
dt = 1e-3
[[controller]]
name = "fixed"
scheme = "baseline"
[[controller]]
name = "fixed, sampled"
scheme = "baseline"
sample_time = 2e-3
[[controller]]
name = "mrac"
scheme = "mrac"
gamma = 1.0
[[controller]]
name = "mrac, sampled"
scheme = "mrac"
gamma = 1.0
sample_time = 2e-3
[[controller]]
name = "l1"
scheme = "l1"
gamma = 1.0
filter = { kappa = 0.01 }
"""
"""k and m act on states that the input does not reach directly, so no theta matches them."""
WITHOUT_BASELINE = """
[[controller]]
name = "piecewise"
scheme = "l1-piecewise"
sample_time = 2e-3
filter = { kappa = 0.02 }
[[controller]]
name = "adrc"
scheme = "adrc"
bandwidth = 30.0
sample_time = 2e-3
[[controller]]
name = "robust"
scheme = "robust-mrac"
tau = 0.02
law = { kind = "gradient", gamma = 5.0 }
"""
KALMAN = '[observer]\nkind = "kalman"\nQ = 10.0\nR = 1e-4'
OBSERVERS = {
    "none": ("", ""),
    "kalman": ("C = [[1, 0, 0, 0], [0, 0, 1, 0]]", KALMAN),
    "derivative": ("C = [[1, 0, 0, 0], [0, 0, 1, 0]]", '[observer]\nkind = "derivative"\ncutoff = 200.0'),
}


def belt(observer, *, baseline=True):
    measured, given = OBSERVERS[observer]
    text = BELT.replace("PLANT", measured).replace("OBSERVER", given)
    if not baseline:
        start, end = text.index("[baseline]"), text.index("[reference_model]")
        text = (text[:start] + text[end:] + WITHOUT_BASELINE).replace("follow", "poles = [-8, -10, [-12, 20]]\nfollow")
        text = text[: text.index('[[controller]]\nname = "fixed"')] + text[text.index('[[controller]]\nname = "mrac"') :]
    return parse_case(text)


@pytest.mark.parametrize("observer", OBSERVERS)
@pytest.mark.parametrize("baseline", [True, False])
def test_the_loop_at_p_is_that_of_the_truth_with_these_parameters(observer, baseline):
    """The plant given by matrices has the same loop as a truth with these parameters, linearised as a whole."""
    case = belt(observer, baseline=baseline)
    plants, frequencies = plants_of(case.problem.design), np.geomspace(1.0, 1000.0, 50)
    for controller in case.controllers:
        linear = linear_because(case.problem.design, controller) is not None
        found = frozen_controller(case.problem.design, controller, linear=linear)
        for plant in (plants[0], plants[3], plants[-1]):
            there = replace(case.problem, truth=Truth(parameters=plant.parameters))
            assert there.delay == plant.delay
            loop, again = found.at(plant), of_the_truth(there, controller, found)
            if found.loop.sampled:
                assert loop.radius(plant.delay) == pytest.approx(again.radius(plant.delay), rel=1e-9)
                loop, again = (one.as_continuous(plant.delay) for one in (loop, again))
            np.testing.assert_allclose(loop.response(frequencies), again.response(frequencies), rtol=1e-6)


def of_the_truth(problem, controller, found):
    """The loop with the estimates that ``found`` has at the problem's parameters."""
    from barbalat.certificates.linear_loops.at_rest import rest_of
    from barbalat.certificates.linear_loops.sampled_rest import adapting_of, sampled_rest

    loop = ClosedLoop.of(problem, controller)
    if not loop.sampled:
        rest = rest_of(problem, loop, frozen=True)
        if (
            controller.name == "robust"
        ):  # in its rates the term Xi theta_hat', which freezing would keep constant, vanishes only at zero
            state = np.zeros(rest.loop.size)
            state[rest.loop.theta_hat_rows] = rest.state[rest.loop.theta_hat_rows]
            rest = replace(rest, state=state)
        return with_dynamics_of_the_truth(problem, rest.broken(frozen=True))
    if not found.ideal:
        return linearised(problem, controller).loop
    adapting = adapting_of(problem, controller.controller)
    return sampled_rest(problem, controller, adapting, frozen=True).with_estimates_frozen().loop


def with_dynamics_of_the_truth(problem, loop):
    (path,), sensor = problem.surroundings.paths, problem.surroundings.sensor
    plant = replace(problem.design.plant, input=path)
    return with_dynamics(replace(problem.design, plant=plant, sensor=sensor), loop)


def test_the_margin_of_the_belt_is_found_by_hand():
    """The LQR, the Kalman filter, the actuator and the lag are computed with SciPy for the nominal plant, and the loop around the
    plant at each corner."""
    case = belt("kalman")
    certificate = certify(case.problem, case.controllers[:1], case.simulation)["fixed"]
    (found,) = certificate.values["margins_over_known_set"]

    def plant(m, k):
        J = 0.03 + m * 0.0625
        return np.array([[0, 1, 0, 0], [-k / 0.08, -0.3 / 0.08, k / 0.08, 0], [0, 0, 0, 1], [k / J, 0, -k / J, -2.0]])

    b, C = np.array([0, 6.0, 0, 0]), np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0]])
    A_0 = plant(0.75, 60.0)
    K = b @ solve_continuous_are(A_0, b[:, None], np.diag([3.0, 0.01, 30.0, 0.02]), np.eye(1))
    gain = solve_continuous_are(A_0.T, C.T, 10.0 * np.eye(4), 1e-4 * np.eye(2)) @ C.T / 1e-4
    observer = A_0 - np.outer(b, K) - gain @ C
    w = np.geomspace(0.5, 2000.0, 60000)
    s, eye = 1j * w[:, None, None], np.eye(4)
    compensator = K @ np.linalg.solve(s * eye - observer, gain[None].astype(complex))

    def remaining(m, k, tau, d):
        A, zero = plant(m, k), np.zeros((4, 4))
        path = np.zeros((4, 1))
        lag = tau / 2
        whole = np.block([
            [A, zero, zero, b[:, None]],
            [eye / lag, -eye / lag, zero, path],
            [zero, gain @ C, observer, path],
            [np.zeros((1, 8)), -K[None] / tau, -np.eye(1) / tau],
        ])  # fmt: skip
        assert np.linalg.eigvals(whole).real.max() < 0
        response = np.linalg.solve(s * eye - A, b[None, :, None].astype(complex))[:, :, 0]
        L = (compensator * (response @ C.T)).sum(axis=1)
        L = L / (tau * 1j * w + 1) / (lag * 1j * w + 1)
        cross = np.flatnonzero(np.diff(np.sign(np.abs(L) - 1)))
        lags = np.angle(-L[cross]) % (2 * np.pi)
        return (lags / w[cross]).min() - d

    corners = [(m, k, tau, d) for m in (0.0, 1.5) for k in (30.0, 90.0) for tau in (0.002, 0.008) for d in (0.006, 0.012)]
    by_hand = {corner: remaining(*corner) for corner in corners}
    least = min(by_hand, key=by_hand.get)
    assert by_hand[least] > 0
    assert found["delay_margin"]["value"] == pytest.approx(by_hand[least], rel=2e-3)
    assert tuple(found["delay_margin"]["parameters"].values()) == least


ARM = """
name = "arm"
[parameters]
m = { value = 0.75, between = [0.0, 1.5] }
B = { value = 0.25, tolerance = 0.1 }
[plant]
A = [[0, 1], [0, "-B/(0.032+m*0.0625)"]]
b = [0, "0.5/(0.032+m*0.0625)"]
[plant.input]
delay = 0.008
[baseline]
kind = "state"
K = [30.0, 5.0]
[reference_model]
follow = "x_1"
[reference]
kind = "step"
amplitude = 0.1
[simulation]
t_end = 1.0
dt = 1e-3
[[controller]]
name = "sampled"
scheme = "baseline"
sample_time = 2e-3
"""


def radius_of_the_arm(m, B, extra):
    """The spectral radius of the map to x[k + 1] by the matrix exponential, with u delayed by whole samples and a part of one."""
    J, T, delay = 0.032 + m * 0.0625, 2e-3, 0.008 + extra
    whole, part = int(delay / T + 1e-9), delay % T if delay % T < T - 1e-12 else 0.0
    A = np.zeros((3, 3))
    A[:2] = [[0, 1, 0], [0, -B / J, 0.5 / J]]
    late, early = expm(A * (T - part)), expm(A * part)
    M = np.zeros((2 + whole + 1,) * 2)
    M[:2, :2] = expm(A * T)[:2, :2]
    K = np.zeros(len(M))
    K[:2] = [30.0, 5.0]
    for age, effect in ((whole, late[:2, 2]), (whole + 1, late[:2, :2] @ early[:2, 2])):
        M[:2] += np.outer(effect, -K) if age == 0 else np.outer(effect, np.eye(len(M))[1 + age])
    M[2] -= K
    for row in range(3, len(M)):
        M[row, row - 1] = 1.0
    return np.abs(np.linalg.eigvals(M)).max()


def test_the_sampled_arm_is_found_by_hand():
    certificate, found = certified(ARM)["sampled"]
    least, at = found["delay_margin"]["value"], found["delay_margin"]["parameters"]
    assert at["m"] == 0.0
    corners = [(m, B) for m in (0.0, 1.5) for B in (0.225, 0.275)]
    assert max(radius_of_the_arm(m, B, 0.999 * least) for m, B in corners) < 1
    assert radius_of_the_arm(**at, extra=1.001 * least) > 1
    assert "in the ranges, at m = 0, B = " in margin_line(certificate)
    stiff = certified(ARM.replace("K = [30.0, 5.0]", "K = [60.0, 12.0]"))["sampled"][1]
    assert stiff["unstable_at_parameters"]["m"] == 0.0


def test_parameters_of_the_path_alone_are_varied_too():
    """Only the delay has a range, and the longest delay gives the smallest margin."""
    text = ARM.replace(
        "m = { value = 0.75, between = [0.0, 1.5] }\nB = { value = 0.25, tolerance = 0.1 }",
        "m = 0.75\nB = 0.25\nd = { value = 0.008, between = [0.004, 0.02] }",
    )
    text = text.replace("delay = 0.008", 'delay = "d"')
    certificate, found = certified(text)["sampled"]
    assert found["delay_margin"]["parameters"] == {"d": 0.02}
    assert found["delay_margin"]["value"] == pytest.approx(certificate.values["delay_margin"] - 0.012, rel=1e-6)


def test_fast_adaptation_around_any_plant():
    """w follows from b'P (x_hat - x) = 0 in the frequency domain. For a matched plant this is the known formula."""
    random = np.random.default_rng(3)
    A_m, b, C = np.array([[0, 1, 0], [0, 0, 1], [-6.0, -11, -6]]), np.array([0, 0, 1.0]), input_filter(0.1).realise()
    from scipy.linalg import solve_continuous_lyapunov

    P = solve_continuous_lyapunov(A_m.T, -np.eye(3))
    A, b_p = A_m + 0.5 * random.standard_normal((3, 3)), np.array([0.1, 0.2, 1.4])
    w = np.array([0.3, 1.0, 5.0, 40.0])
    found = fast_adaptation_on(A, b_p, C, A_m, b, P).response(w)
    for at, value in zip(1j * w, found, strict=True):
        x, W = np.linalg.solve(at * np.eye(3) - A, b_p), b @ P @ np.linalg.solve(at * np.eye(3) - A_m, b)
        filtered = 1 / (0.1 * at + 1)
        assert value == pytest.approx(filtered / (1 - filtered) * (b @ P @ x) / W, rel=1e-9)
    case = parse_case(PENDULUM.replace("RANGE", "[8.0, 10.0]"))
    plant = replace(
        case.problem.design.plant,
        A_m=A_m,
        b=b,
        theta=np.array([1.0, -2.0, 0.5]),
        baseline=None,
        x0=np.zeros(3),
        nominal_A=None,
        scale=None,
    )
    matched = fast_adaptation_on(A_m + np.outer(b, plant.theta), b, C, A_m, b, P).response(w)
    np.testing.assert_allclose(matched, fast_adaptation(plant, C).response(w), rtol=1e-9)


def test_ranges_that_give_no_path_are_a_note():
    """At its lower end the delay would be negative. certify says so, and the other numbers remain."""
    text = ARM.replace("B = { value = 0.25, tolerance = 0.1 }", "B = 0.25\nd = { value = 0.008, between = [-0.001, 0.01] }")
    case = parse_case(text.replace("delay = 0.008", 'delay = "d"'))
    certificate = certify(case.problem, case.controllers, case.simulation)["sampled"]
    assert certificate.values["delay_margin"] > 0 and "margins_over_known_set" not in certificate.values
    (said,) = (note for note in certificate.notes if note.startswith("no margins over the parameters' ranges"))
    assert "plant.input.delay must not be negative" in said
