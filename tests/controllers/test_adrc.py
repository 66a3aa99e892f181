"""Active disturbance rejection: the textbook controllers, the related L1 schemes, and the signals of its observer."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from barbalat import Adrc, L1PiecewiseConstant, Plant, Problem, ReferenceModel, Sampled, input_filter, simulate
from barbalat.certificates.linear_loops.ideal import fast_adaptation
from barbalat.certificates.schemes.adrc import loop_at
from barbalat.linear.systems import sensitivity
from barbalat.plants import PlantInput
from barbalat.signals import Constant, Step
from barbalat.solvers.simulation import Simulation
from independent import refusal

W = np.geomspace(1e-2, 1e3, 40)


def test_the_textbook_s_first_order_controller():
    """Herbst (2013) has u = (K_p (r - z_1) - z_2)/b_0 with l_1 = 2 omega_o and l_2 = omega_o^2 for the integrator y' = b_0 u + f.

    By hand, the controller from y to -u is [(K_p l_1 + l_2) s + K_p l_2]/[b_0 s (s + l_1 + K_p)]. K_p is the model's pole.
    """
    K_p, omega_o, b_0, theta = 3.0, 12.0, 2.0, 1.5
    plant = Plant(A_m=[[-K_p]], b=[1.0], theta=[theta])
    known = Problem(plant=plant, reference_model=ReferenceModel(k_0=K_p)).known
    equations = Adrc(bandwidth=omega_o, output=[1.0], nominal=[K_p], b_0=b_0).bind(known)
    l_1, l_2, s = 2 * omega_o, omega_o**2, 1j * W
    by_hand = ((K_p * l_1 + l_2) * s + K_p * l_2) / (b_0 * s * (s + l_1 + K_p)) / (s - (theta - K_p))
    np.testing.assert_allclose(loop_at(plant.theta, equations, known).response(W), by_hand, rtol=1e-9)


def test_the_textbook_s_second_order_loop_has_its_poles_where_the_bandwidths_are():
    """For a double integrator with K_p = omega_c^2 and K_d = 2 omega_c the polynomial is (s + omega_c)^2 (s + omega_o)^3. The
    tolerance of its coefficients is 1e-9."""
    omega_c, omega_o = 2.0, 10.0
    K = np.array([omega_c**2, 2 * omega_c])
    plant = Plant(A_m=[[0.0, 1.0], -K], b=[0.0, 1.0], theta=K)  # x'' = u
    known = Problem(plant=plant, reference_model=ReferenceModel(k_0=omega_c**2)).known
    equations = Adrc(bandwidth=omega_o, output=[1.0, 0.0], nominal=K).bind(known)
    closed = np.poly(sensitivity(loop_at(K, equations, known)).A)
    np.testing.assert_allclose(closed, np.poly([-omega_c] * 2 + [-omega_o] * 3), rtol=1e-9)


def test_with_the_whole_state_it_is_the_limit_of_l1_with_fast_adaptation(section_v):
    """L = C/(1 - C) (1 + theta'G) with C = omega_o/(s + omega_o)."""
    plant, omega_o = section_v.plant, 40.0
    limit = fast_adaptation(plant, input_filter(1 / omega_o).realise())
    own = loop_at(plant.theta, Adrc(bandwidth=omega_o).bind(section_v.known), section_v.known)
    np.testing.assert_allclose(own.response(W), limit.response(W), rtol=1e-9)


def test_the_piecewise_constant_law_tends_to_it_with_its_sample_time(section_v):
    """The law's estimate is a difference over one sample of length T, so the two runs differ by the order of T.

    In the piecewise-constant law k_0 r passes through C. Here both follow a constant command of zero from x_0.
    """
    problem = replace(section_v, reference=Constant(0.0))
    (linear,) = simulate(problem, [Adrc(bandwidth=20.0)], Simulation(t_end=4.0, dt=1e-3)).values()
    away = []
    for T in (8e-3, 4e-3):
        law = L1PiecewiseConstant(sample_time=T, filter=input_filter(0.05))
        (run,) = simulate(problem, [law], Simulation(t_end=4.0, dt=1e-3)).values()
        away.append(np.abs(run.x[-1] - linear.x[-1]).max() / np.abs(linear.x).max())
    assert away[1] < 0.55 * away[0] < 0.1


def test_a_constant_disturbance_vanishes_and_is_what_is_estimated(problems):
    """With f = theta'x + d the estimation error satisfies f_tilde' = -omega_o f_tilde - f' and vanishes at equilibrium."""
    problem = replace(problems[2], reference=Constant(1.0), disturbance=Step(amplitude=3.0, start=1.0))
    for controller in (Adrc(bandwidth=10.0), Adrc(bandwidth=15.0, output=[1.0, 0.0])):
        (run,) = simulate(problem, [controller], Simulation(t_end=40.0, dt=2e-3)).values()
        assert np.abs(run.e[-1]).max() < 1e-9
        state = run.loop.unpack(run.states[-1]).controller
        _, f_hat = run.loop.equations.observer.estimates(state.xi, run.x[-1])
        assert f_hat == pytest.approx([problem.plant.theta @ run.x[-1] + 3.0], abs=1e-9)


def test_the_estimate_against_the_exact_response_of_its_filter(problems):
    """f_hat = omega_o/(s + omega_o) [f] along a run, by the exact response between samples of f. The tolerance is 1e-5 because f
    is averaged over 1 ms."""
    omega_o, problem = 5.0, problems[2]
    (run,) = simulate(problem, [Adrc(bandwidth=omega_o)], Simulation(t_end=5.0, dt=1e-3, record_points=5000)).values()
    f = run.x @ problem.plant.theta
    follows, decay = [0.0], expm(np.array([[-omega_o * 1e-3]]))[0, 0]
    for before, now in pairwise(f):
        follows.append(decay * follows[-1] + (1 - decay) * (before + now) / 2)
    observer = run.loop.equations.observer
    for k in range(0, len(f), 500):
        _, f_hat = observer.estimates(run.loop.unpack(run.states[k]).controller.xi, run.x[k])
        assert f_hat == pytest.approx([follows[k]], abs=1e-5 * np.abs(f).max())


def test_several_inputs():
    """Each input has its own disturbance, and the effect of both vanishes with a coupled b."""
    plant = Plant(A_m=[[-2.0, 0.0], [0.0, -3.0]], b=[[1.0, 0.2], [0.0, 1.0]], theta=[0.5, -0.3, 0.2, 0.4], x0=[0.3, -0.2])
    problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=2 * np.eye(2)), reference=(Constant(1.0), Constant(-0.5)))
    (run,) = simulate(problem, [Adrc(bandwidth=20.0, nominal=[0.1, 0.0, 0.0, 0.3])], Simulation(t_end=20.0, dt=2e-3)).values()
    assert np.abs(run.e[-1]).max() < 1e-9


def test_a_limit_that_the_observer_knows_does_not_wind_it_up(problems):
    """A disturbance of 3 acts for 5 s with |u| <= 1. Afterwards an observer with u as its input demands far more than needed."""
    plant = replace(problems[2].plant, input=PlantInput(saturation=[-1.0, 1.0]), theta=[0.0, 0.0], x0=[0.0, 0.0])
    held = Step(amplitude=3.0, start=1.0)
    problem = replace(problems[2], plant=plant, reference=Constant(0.0), disturbance=held, uncertainty=None)
    simulation = Simulation(t_end=10.0, dt=1e-3)
    fed, saturated = (
        simulate(problem, [Adrc(bandwidth=10.0, saturated_predictor=on)], simulation)["ADRC"] for on in (False, True)
    )
    assert abs(saturated.u[-1]) == pytest.approx(3.0, rel=1e-3)  # the input that would be needed
    assert abs(fed.u[-1]) > 20.0


def test_sampled_it_tends_to_the_continuous_one(problems):
    """At 40 ms and 20 ms under a constant command, the error of the trapezoidal rule is of second order after the start, and the
    error of ZOH is of first order."""
    problem = replace(problems[2], reference=Constant(1.0))
    simulation = Simulation(t_end=2.0, dt=2e-3)
    for adrc in (Adrc(bandwidth=5.0), Adrc(bandwidth=5.0, output=[1.0, 0.0])):
        (continuous,) = simulate(problem, [adrc], simulation).values()
        away = []
        for T in (0.04, 0.02):
            (run,) = simulate(problem, [Sampled(controller=adrc, sample_time=T)], simulation).values()
            away.append(np.abs(run.x[-1] - continuous.x[-1]).max())
        assert away[1] < 0.6 * away[0]


def test_what_the_output_does_not_see_is_refused(problems):
    known = problems[2].known
    assert "must make every state" in refusal(lambda: Adrc(bandwidth=5.0, output=[0.0, 1.0]).bind(known))  # f is not constant
    assert "must make every state" in refusal(lambda: Adrc(bandwidth=5.0, output=[0.0, 0.0]).bind(known))
    assert "output" in refusal(lambda: Adrc(bandwidth=5.0, output=[1.0]).bind(known))
    assert "bandwidth" in refusal(lambda: Adrc(bandwidth=0.0))
    two = Plant(A_m=-np.eye(2), b=np.eye(2), theta=np.zeros(4))
    several = Problem(plant=two, reference_model=ReferenceModel(k_0=[[1.0], [0.0]])).known
    assert "one input" in refusal(lambda: Adrc(bandwidth=5.0, output=[1.0, 0.0]).bind(several))
