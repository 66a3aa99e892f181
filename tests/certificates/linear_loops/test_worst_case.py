"""Margins over the known set, compared with a dense grid of exact margins, and the two computations of a response, compared with
each other."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest

from barbalat import InputError, L1Adaptive, Mrac, ParameterBox, Plant, TransferFunction, input_filter
from barbalat.cases.load import load_case
from barbalat.certificates.certify import certify
from barbalat.certificates.linear_loops.ideal import fast_adaptation, known_parameters
from barbalat.certificates.linear_loops.worst_case import LoopsOverTheta, screen, worst_case
from barbalat.cli import main
from barbalat.linear.margins import margins
from barbalat.linear.systems import StateSpace, sensitivity
from barbalat.papers.jafari_2013.section_v import variant
from barbalat.plants import PlantInput
from barbalat.problem.known_set import ParameterBall
from barbalat.solvers.simulation import Simulation

SIMULATION = Simulation(t_end=60.0, dt=1e-4)
ACTUATOR = PlantInput(actuator=TransferFunction([2500.0], [1.0, 100.0, 2500.0]))


def family_of(plant, C):
    return {
        "rest": LoopsOverTheta(plant, lambda p: known_parameters(p, p.theta)),
        "filtered": LoopsOverTheta(plant, lambda p: known_parameters(p, p.theta, C)),
        "fast": LoopsOverTheta(plant, lambda p: fast_adaptation(p, C)),
    }


def families():
    for name, input in (("paper", None), ("third-order", None), ("paper", ACTUATOR)):
        case = load_case(name)
        plant = replace(case.problem.plant, input=input)
        C = next(c for c in case.controllers if c.name == "L1").bind(case.problem.known).C
        for label, family in family_of(plant, C).items():
            yield pytest.param(family, case.problem.uncertainty, id=f"{name}-{label}{'-actuator' if input else ''}")


@pytest.mark.parametrize(("family", "box"), list(families()))
@pytest.mark.short(kept=lambda family, box: family.plant.n == 2)
def test_no_point_of_a_dense_grid_is_worse(family, box):
    """The exact margins are on a lattice that contains the vertices. The tolerance is 1e-3 because the search finds an interior
    minimum up to its last width."""
    axes = [np.linspace(low, high, {2: 13, 3: 5}[box.size]) for low, high in zip(box.lower, box.upper, strict=True)]
    lattice = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, box.size)
    found = worst_case(family, box)
    closed = [np.linalg.eigvals(sensitivity(family.loop(theta)).A).real.max() for theta in lattice]
    assert (found.unstable_at is not None) == (max(closed) >= 0)
    if found.unstable_at is not None:
        assert np.linalg.eigvals(sensitivity(family.loop(found.unstable_at)).A).real.max() >= 0
        return
    exact = [margins(family.loop(theta)) for theta in lattice]
    for name in ("delay", "phase", "gain_up"):
        assert found.least[name][0] <= min(getattr(m, name) for m in exact) * 1.001
    assert found.least["gain_down"][0] >= max(m.gain_down for m in exact) - 1e-3
    for name, (value, theta) in found.least.items():
        assert box.contains(theta)
        assert getattr(margins(family.loop(theta)), name) == value  # none comes from the screening's interpolation


@pytest.mark.parametrize(("family", "box"), list(families()))
def test_the_vectorised_response_and_spectrum_are_the_loops_own(family, box):
    rng = np.random.default_rng(3)
    thetas, w = rng.uniform(box.lower, box.upper, (20, box.size)), np.geomspace(1e-2, 1e3, 30)
    own = np.array([family.loop(theta).response(w) for theta in thetas])
    N, D = family.responses(w)(thetas)
    np.testing.assert_allclose(N / D, own, rtol=1e-8)
    spectra = [np.linalg.eigvals(sensitivity(family.loop(theta)).A).real.max() for theta in thetas]
    np.testing.assert_allclose(
        family.largest_real_parts(thetas), spectra, atol=1e-6
    )  # a double pole, so the error is the square root of rounding


class Bump(LoopsOverTheta):
    """L = k/(s (s + 1)) with k = 5 - |theta - (0.3, -0.2)|^2. The worst point is in the interior, which is rare for matched
    uncertainty."""

    def gain(self, thetas):
        return 5 - np.sum((np.atleast_2d(thetas) - [0.3, -0.2]) ** 2, axis=1)

    def loop(self, theta):
        return StateSpace(np.array([[0.0, 1.0], [0.0, -1.0]]), np.array([0.0, 1.0]), np.array([self.gain(theta)[0], 0.0]), 0.0)

    def responses(self, w):
        return lambda thetas: (self.gain(thetas)[:, None] / (1j * w * (1j * w + 1)), np.ones((len(thetas), len(w))))

    def largest_real_parts(self, thetas):
        return np.full(len(thetas), -1.0)


def lightly_damped(count):
    """Plants of order 2 and 3 with damping down to 0.05, a box, a filter and, for half of them, a delay."""
    rng = np.random.default_rng(11)
    for _ in range(count):
        n, w, zeta = int(rng.integers(2, 4)), rng.uniform(0.5, 3), rng.uniform(0.05, 0.9)
        polynomial = np.array([1, 2 * zeta * w, w * w])
        if n == 3:
            polynomial = np.polymul(polynomial, [1, rng.uniform(0.5, 5)])
        A_m = np.diag(np.ones(n - 1), 1)
        A_m[-1] = -polynomial[:0:-1]
        half = rng.uniform(0.05, 1.5, n)
        input = PlantInput(delay=float(rng.uniform(0.001, 0.02))) if rng.integers(2) else None
        plant = Plant(A_m=A_m, b=np.eye(n)[-1], theta=rng.uniform(-half, half), x0=np.zeros(n), input=input)
        yield plant, ParameterBox(lower=-half, upper=half), input_filter(10 ** rng.uniform(-2, -0.5)).realise()


@pytest.mark.dear
def test_never_better_than_at_a_vertex_or_at_the_case_s_theta(sample):
    compared = 0
    for plant, box, C in lightly_damped(sample(3, 8)):
        vertices = [np.where(signs, box.upper, box.lower) for signs in itertools.product((False, True), repeat=plant.n)]
        for family in family_of(plant, C).values():
            found = worst_case(family, box)
            if found.unstable_at is not None:
                with pytest.raises(InputError, match=r"unstable|stable closed loop"):
                    margins(family.loop(found.unstable_at), family.delay)
                continue
            exact = [margins(family.loop(theta), family.delay) for theta in (*vertices, plant.theta)]
            for name in ("delay", "phase", "gain_up"):
                assert found.least[name][0] <= min(getattr(m, name) for m in exact)
            assert found.least["gain_down"][0] >= max(m.gain_down for m in exact)
            compared += 1
    assert compared >= sample(4, 10)


def test_a_pole_beside_the_axis_is_no_crossing():
    """A plant with damping 0.05 and a box in which the damping falls to 0.0013. The reported factor is the factor of the loop,
    above 1."""
    A_m = [[0.0, 1.0], [-2.5053107653324966, -0.15779347601555097]]
    plant = Plant(A_m=A_m, b=[0.0, 1.0], theta=[-0.5, -2.2], x0=[0.0, 0.0])
    box = ParameterBox(lower=[-0.5212298, -2.2170026], upper=[0.5212298, 2.2170026])
    value, theta = worst_case(family_of(plant, None)["rest"], box).least["gain_up"]
    # k theta_2 = 0.1578, where the damping is zero with theta_2 of the vertex
    assert value == pytest.approx(1 + 0.15779347601555097 / 2.2170026, rel=1e-9)
    assert theta[1] == -2.2170026


def test_the_screening_agrees_with_the_exact_margins():
    """The two agree at random points of the set, with and without delay. The tolerance 0.03 is the interpolation's error near a
    pole of L close to the axis."""
    rng = np.random.default_rng(2)
    for plant, box, C in lightly_damped(4):
        for family in family_of(plant, C).values():
            thetas = rng.uniform(box.lower, box.upper, (40, plant.n))
            w = family.frequencies(thetas)
            N, D = family.responses(w)(thetas)
            screened = screen(N * np.exp(-1j * w * family.delay), D, w, family.delay)
            for k, theta in enumerate(thetas):
                try:
                    exact = margins(family.loop(theta), family.delay)
                except InputError:
                    continue
                assert screened["delay"][k] - family.delay == pytest.approx(exact.delay, rel=0.03)
                assert screened["phase"][k] == pytest.approx(exact.phase, rel=0.03)
                assert 1 - screened["gain_down"][k] == pytest.approx(exact.gain_down, abs=0.03)
                if exact.gain_up < 100:  # beyond, it may lie above the grid
                    assert screened["gain_up"][k] == pytest.approx(exact.gain_up, rel=0.03)


def test_an_interior_worst_case_is_found():
    """The tolerance is 1e-4. Its square root times the width is the distance that remains after the last round."""
    family = Bump(load_case("paper").problem.plant, None)
    value, theta = worst_case(family, ParameterBox(lower=[-1.0, -1.0], upper=[1.0, 1.0])).least["delay"]
    np.testing.assert_allclose(theta, [0.3, -0.2], atol=0.01)
    assert value == pytest.approx(margins(family.loop(np.array([0.3, -0.2]))).delay, rel=1e-4)


def test_a_ball_is_searched_to_its_surface():
    family = family_of(load_case("paper").problem.plant, None)["rest"]
    ball = ParameterBall(center=[1.0, -1.0], radius=2.0)
    found = worst_case(family, ball)
    angles = np.linspace(0, 2 * np.pi, 73)
    exact = [margins(family.loop(ball.center + 2 * np.array([np.cos(a), np.sin(a)]))).delay for a in angles]
    assert found.least["delay"][0] <= min(exact) * 1.001
    assert np.linalg.norm(found.least["delay"][1] - ball.center) <= 2 * (1 + 1e-12)


def test_the_certificate_says_how_it_searched(capsys):
    assert main(["certify", "paper", "--json"]) == 0
    controllers = json.loads(capsys.readouterr().out)["controllers"]
    for name, count in (("MRAC", 1), ("L1", 2), ("Robust MRAC", 1)):
        entries = controllers[name]["margins_over_known_set"]
        assert len(entries) == count and "margins_over_known_set" not in controllers[name]["guaranteed"]
        for entry in entries:
            assert "not a guarantee" in entry["searched"]
        assert entries[0]["delay_margin"]["value"] <= controllers[name]["delay_margin"]
    # 1/L + 1 = 0 at s = 0: with theta_1 = -5 the stiffness 0.3 + (k - 1) theta_1 is zero at k = 1.06
    assert controllers["MRAC"]["margins_over_known_set"][0]["gain_margin"]["value"] == pytest.approx(1.06, rel=1e-6)


def test_a_delay_that_part_of_the_set_does_not_bear_is_a_finding():
    found = certify(variant(input=PlantInput(delay=0.2)), (Mrac(gamma=1.0),), SIMULATION)["MRAC"]
    assert found.values["delay_margin"] > 0
    assert "unstable_at" in found.values["margins_over_known_set"][0]
    assert any("of the known set" in finding for finding in found.findings)


def test_a_filter_too_slow_for_part_of_the_set_is_a_finding():
    """With kappa = 10 the filtered loop with estimates frozen at theta = [5, 5] is unstable."""
    found = certify(variant(), (L1Adaptive(gamma=1.0, filter=input_filter(10.0)),), SIMULATION)["L1"]
    assert any("unstable at theta" in finding for finding in found.findings)
