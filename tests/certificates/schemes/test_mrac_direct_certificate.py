"""The certificate of the direct MRAC, compared with numbers computed by hand, with runs of random problems, and at the vertices
of a known set."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from barbalat import DirectMrac, ParameterBox, Plant, Problem, ReferenceModel, certify, load_case, simulate
from barbalat.certificates.certificates import table_1
from barbalat.plants import ParameterBall, PlantInput
from barbalat.regressors import Terms
from barbalat.signals import Constant, Sine
from barbalat.solvers.simulation import Simulation

SIMULATION = Simulation(t_end=10.0, dt=1e-3)


def test_the_textbook_s_plant_by_hand():
    """P = 1/4 and V(0) = omega (k_x^2 + k_r^2)/Gamma = 0.5 (4 + 16)/4 = 2.5, so |e| <= sqrt(2.5/0.25). The tolerance 1e-9 is for
    outward rounding.

    The loop gain is omega k_x/(s + 1) = 1/(s + 1), so no delay destabilises the loop.
    """
    case = load_case("astrom-wittenmark")
    found = certify(case.problem, case.controllers, case.simulation)["Direct MRAC"]
    assert found.values["error_bound"] == pytest.approx(np.sqrt(10), rel=1e-9)
    assert "error_bound" in found.guaranteed
    assert (found.values["k_x"], found.values["k_r"]) == ([2.0], 4.0)
    assert "delay_margin" in found.values["unlimited"]
    # omega (Gamma |x|^2 + gamma_r r^2) b'P b with |x| <= |x_m| + |e| <= 1 + sqrt(10), |r| = 1
    assert found.values["adaptation_frequency"] == pytest.approx(np.sqrt(0.5 * 4 / 4) * (2 + np.sqrt(10)), rel=1e-6)
    dt, offset, e = 1e-3, np.sqrt(0.5) * 2, np.sqrt(0.5) * np.sqrt(10) * 2
    assert found.values["gamma_max"] == pytest.approx(((2 * np.sqrt(2) / dt * 2 - e) / offset) ** 2, rel=1e-6)


def random_member(problems, seed):
    """A random problem of order 1 to 3 with an arbitrary input gain in a known interval, with a scalar, diagonal or matrix gain,
    and with a box, a ball or no known set."""
    rng = np.random.default_rng(seed)
    n = 1 + seed % 3
    given, theta, omega = problems[n], rng.uniform(-1.0, 1.0, n), 10 ** rng.uniform(-0.5, 0.5)
    box, ball = ParameterBox(lower=-2 * np.ones(n), upper=2 * np.ones(n)), ParameterBall(center=np.zeros(n), radius=2.0)
    root = rng.normal(size=(n, n))
    sizes = (10 ** rng.uniform(0, 2), 10 ** rng.uniform(0, 2, n), 5 * (root @ root.T + 0.3 * np.eye(n)))
    known = seed // 3 % 4
    problem = replace(
        given,
        plant=replace(given.plant, theta=theta, x0=rng.normal(size=n), input=PlantInput(gain=omega)),
        uncertainty=(box, ball, None, None)[known],
        input_gain=(omega / 2, 2 * omega) if known < 3 else None,
        reference=Sine(amplitude=rng.uniform(0.1, 5), frequency=10 ** rng.uniform(-1, 1)),
    )
    return problem, DirectMrac(gamma=sizes[seed // 12 % 3], gamma_r=10 ** rng.uniform(-1, 1))


def test_the_bound_holds_along_runs(problems, sample):
    for seed in range(sample(12, 72)):
        problem, controller = random_member(problems, seed)
        (found,) = certify(problem, [controller], SIMULATION, keys=("error_bound", "error_bound_worst")).values()
        (run,) = simulate(problem, [controller], SIMULATION).values()
        assert "error_bound" in found.guaranteed
        assert max(run.figures["max_abs_e"]) <= found.values["error_bound"], seed
        assert found.values["error_bound"] <= found.values.get("error_bound_worst", np.inf)


TERMS = {1: ("sin(x1)",), 2: ("x1*x2", "sin(x2)"), 3: ("x1*x2", "x3", "tanh(x1)")}


def test_the_bound_holds_for_another_regressor_too(problems, sample):
    for seed in range(sample(6, 36)):
        problem, controller = random_member(problems, seed)
        problem = replace(problem, plant=replace(problem.plant, regressor=Terms(terms=TERMS[problem.plant.n])))
        (found,) = certify(problem, [controller], SIMULATION, keys=("error_bound", "delay_margin")).values()
        (run,) = simulate(problem, [controller], SIMULATION).values()
        assert "error_bound" in found.guaranteed and "delay_margin" not in found.values
        assert max(run.figures["max_abs_e"]) <= found.values["error_bound"], seed


def test_the_worst_of_the_known_set_is_at_a_vertex(problems):
    """V(0) is convex in (theta, omega), so the worst bound is the largest one at the vertices of box and interval. The tolerance
    1e-9 is for outward rounding."""
    box, given = ParameterBox(lower=[-1.0, -2.0], upper=[4.0, 0.5]), problems[2]
    controller = DirectMrac(gamma=3.0, gamma_r=0.7, theta_hat0=[0.3, -0.1], k_r0=3.0)

    def at(a, c, omega):
        plant = replace(given.plant, theta=np.array([a, c]), input=PlantInput(gain=omega))
        problem = replace(given, plant=plant, uncertainty=box, input_gain=(0.5, 3.0))
        return certify(problem, [controller], SIMULATION, keys=("error_bound", "error_bound_worst"))[controller.name].values

    vertices = [at(a, c, omega) for a in (-1.0, 4.0) for c in (-2.0, 0.5) for omega in (0.5, 3.0)]
    inside = [at(a, c, omega) for a, c, omega in ((0.0, 0.0, 1.0), (3.0, -1.0, 0.7), (-0.5, 0.2, 2.5))]
    worst = vertices[0]["error_bound_worst"]
    assert max(values["error_bound"] for values in vertices) == pytest.approx(worst, rel=1e-9)
    assert max(values["error_bound"] for values in inside) < worst


def two_inputs(**more):
    """A problem with two inputs and theta (2, 2), given by rows."""
    wanted = {"theta": [0.5, -1.0, 0.8, 0.2], "omega": (1.0, 2.0), "reference": [Sine(1.0, 1.0), Sine(1.0, 2.0)]} | more
    inputs = [PlantInput(gain=one) for one in wanted.pop("omega")]
    plant = Plant(A_m=[[-1.0, 0.3], [-0.5, -2.0]], b=[[1.0, 0.2], [0.0, 1.5]], theta=wanted.pop("theta"), input=inputs)
    return Problem(plant=plant, reference_model=ReferenceModel(k_0=[[1.0, 0.0], [0.5, 2.0]]), **wanted)


@pytest.mark.parametrize("gamma", [3.0, [1.0, 5.0, 0.5, 20.0]], ids=["number", "diagonal"])
@pytest.mark.short(kept=lambda gamma: gamma != 3.0)
def test_the_worst_of_several_inputs_is_at_a_vertex_of_all_their_sets(gamma):
    """Theta's box and two intervals have 16 vertices. The bound for a ball is at least the bound for each of its points. The
    tolerance 1e-9 is for outward rounding."""
    intervals, controller = ((0.5, 2.0), (1.0, 3.0)), DirectMrac(gamma=gamma, gamma_r=0.7, theta_hat0=[0.3, -0.1, 0.0, -0.2])
    box = ParameterBox(lower=[-1.0, -2.0, 0.0, -0.5], upper=[1.0, 0.5, 0.0, -0.5])

    def at(theta, omega, known_set):
        problem = two_inputs(theta=theta, omega=omega, uncertainty=known_set, input_gain=intervals)
        return certify(problem, [controller], SIMULATION, keys=("error_bound", "error_bound_worst"))[controller.name].values

    thetas = product(*zip(box.lower.tolist(), box.upper.tolist(), strict=True))
    found = [at(theta, omega, box) for theta, omega in product(sorted(set(thetas)), product(*intervals))]
    assert max(values["error_bound"] for values in found) == pytest.approx(found[0]["error_bound_worst"], rel=1e-9)
    rng, ball = np.random.default_rng(0), ParameterBall(center=[0.1, -0.2, 0.3, 0.0], radius=1.5)
    drawn = [at(theta, (0.5, 3.0), ball) for theta in ball.center + 0.999 * (ball.extreme_points(rng, 8) - ball.center)]
    largest = max(values["error_bound"] for values in drawn)
    assert largest <= drawn[0]["error_bound_worst"] <= 1.2 * largest


def test_a_set_made_without_an_interval_bounds_no_other_theta_s_gains():
    """The theta/omega of the case is in the box, but the one at the box's corner is not, and a run at the corner would violate
    such a bound."""
    problem = two_inputs(
        omega=(0.25, 1.0), theta=[0.1, 0.0, 0.0, 0.0], uncertainty=ParameterBox(lower=-np.ones(4), upper=np.ones(4))
    )
    found, _ = judged(problem, DirectMrac(gamma=2.0))
    assert "error_bound" in found.guaranteed and "error_bound_worst" not in found.guaranteed
    assert "without a known interval" in found.entry("error_bound_worst").why
    assert "error_bound_worst" in judged(problem, DirectMrac(gamma=2.0, projection=False))[0].guaranteed


def test_margins_of_each_input_are_with_the_ideal_gains():
    """With omega k_x = theta and a factor g on u_1 alone, A_m + b_1 theta_1'(1 - g) has eigenvalues on the imaginary axis at the
    gain margin.

    The tolerance 1e-6 is the tolerance of the search for the phase crossing.
    """
    problem = two_inputs(theta=[3.0, -1.0, 1.0, 0.2], reference=[Constant(1.0), Constant(-0.5)])
    found, _ = judged(problem, DirectMrac(gamma=5.0))
    A_m, b, theta = problem.plant.A_m, problem.plant.b, problem.plant.theta.reshape(2, 2)
    ends = found.values["gain_reduction_margin_each"]
    assert ends[0] > 0.1
    for i, g in enumerate(ends):
        if g > 0:
            assert np.linalg.eigvals(A_m + np.outer(b[:, i], theta[:, i]) * (1 - g)).real.max() == pytest.approx(0.0, abs=1e-6)


def judged(problem, controller):
    certificates = certify(problem, [controller], SIMULATION)
    (column,) = table_1(problem, [controller], certificates).columns
    return certificates[controller.name], column


def test_where_an_ideal_gain_is_out_of_reach_nothing_is_claimed(problems):
    """theta is in the set, but theta/omega is not, and the designer, who knows no interval, projects onto the set."""
    problem = replace(problems[1], plant=replace(problems[1].plant, input=PlantInput(gain=0.3)))
    found, column = judged(problem, DirectMrac(gamma=2.0))
    assert "error_bound" not in found.values and "ideal gains outside" in found.entry("error_bound").why
    assert not column.cells["stability"].applies
    (run,) = simulate(problem, [DirectMrac(gamma=2.0)], Simulation(t_end=60.0, dt=1e-3)).values()
    assert max(run.figures["tail_max_abs_e"]) > 0.1  # and the run does not follow the model
    found, column = judged(problem, DirectMrac(gamma=2.0, projection=False))
    assert "error_bound" in found.guaranteed and column.cells["tracking"].applies


def test_with_a_disturbance_the_error_is_bounded_but_not_said_to_converge():
    """From the ideal gains V(0) = 0, and d moves e, so V grows; the error of the run does not vanish."""
    problem = Problem(
        plant=Plant(A_m=[[-1.0]], b=[1.0], theta=[1.5]),
        reference_model=ReferenceModel(k_0=1.0),
        reference=Sine(amplitude=2.0, frequency=0.5),
        uncertainty=ParameterBox(lower=[-2.0], upper=[2.0]),
        input_gain=(0.5, 3.0),
        disturbance=Sine(amplitude=0.5, frequency=3.0),
    )
    found, column = judged(problem, DirectMrac(gamma=20.0))
    assert "error_bound" in found.guaranteed and column.cells["stability"].applies
    (run,) = simulate(problem, [DirectMrac(gamma=20.0)], Simulation(t_end=200.0, dt=1e-3)).values()
    assert max(run.figures["tail_max_abs_e"]) > 0.02
    assert not column.cells["tracking"].applies and not column.cells["estimates"].applies


def test_nothing_is_claimed_beside_a_delay(problems):
    plant = replace(problems[2].plant, input=PlantInput(gain=2.0, delay=0.1))
    found, _ = judged(replace(problems[2], plant=plant), DirectMrac(gamma=1.0))
    assert "delay 0.1 s" in found.entry("error_bound").why and "gain" not in found.entry("error_bound").why


def test_the_linear_loop_is_that_of_the_ideal_gains(problems):
    """The loop does not depend on omega, because omega k_x = theta. The tolerance 1e-9 is for a further product and quotient."""
    found = []
    for omega in (1.0, 4.0):
        plant = Plant(A_m=[[0.0, 1.0], [-1.0, -1.0]], b=[0.0, 1.0], theta=[3.0, 2.0], input=PlantInput(gain=omega))
        found.append(judged(replace(problems[2], plant=plant, uncertainty=None), DirectMrac(gamma=1.0))[0].values["delay_margin"])
    assert found[0] == pytest.approx(found[1], rel=1e-9)
