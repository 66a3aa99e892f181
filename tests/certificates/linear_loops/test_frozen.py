"""The robust MRAC's frozen loops, compared with a formula, Pade approximations, eigenvalues, H-infinity norms and simulation."""

from dataclasses import replace

import control
import numpy as np
import pytest

from barbalat import NormalizedMrac, ReferenceModel, RobustMrac, Simulation, TransferFunction, simulate_ensemble
from barbalat.certificates.linear_loops.frozen import FrozenLoops, small_gain, tolerated
from barbalat.laws import Gradient, LeastSquares
from barbalat.linear.peaks import peak_gain
from barbalat.linear.systems import complementary_sensitivity, sensitivity, series
from barbalat.plants import PlantInput, Sensor
from barbalat.problem.modelling_error import DelayError, ScaledError
from barbalat.regressors import Polynomial
from barbalat.signals import Constant
from independent import refusal

DERIVATIVE = ScaledError(TransferFunction([-1.0, 0.0], [0.01, 1.0]))
W = np.geomspace(0.05, 200.0, 30)


def scheme(tau, **settings):
    return RobustMrac(**({"tau": tau, "law": LeastSquares(covariance0=1.0)} | settings))


def by_hand(problem, tau, relative_degree, theta_hat, w):
    """[F + (theta_hat + F (theta - theta_hat))'G]/(1 - F)."""
    plant, s = problem.plant, 1j * w
    F = 1 / (tau * s + 1) ** relative_degree
    A = plant.A_m + np.outer(plant.b, plant.theta)
    G = np.array([np.linalg.solve(point * np.eye(plant.n) - A, plant.b) for point in s])
    return (F + G @ theta_hat + F * (G @ (plant.theta - theta_hat))) / (1 - F)


@pytest.mark.parametrize(
    ("order", "c_0", "relative_degree"), [(1, [1.0], 1), (2, [1.0, 0.0], 2), (2, None, 1), (3, [1.0, 0, 0], 3)]
)
@pytest.mark.parametrize("tau", [0.02, 0.7])
def test_the_loop_from_the_equations_is_the_one_by_hand(problems, order, c_0, relative_degree, tau):
    problem = problems[order]
    loops = FrozenLoops(problem, scheme(tau, c_0=c_0))
    for theta_hat in (problem.plant.theta, np.random.default_rng(order).normal(size=order)):
        expected = by_hand(problem, tau, relative_degree, theta_hat, W)
        # 1 - F loses digits where tau w is small
        np.testing.assert_allclose(loops.at(theta_hat).response(W), expected, rtol=1e-7)


def test_without_auxiliary_input_and_with_parts_between(problems):
    """With F = 0 the loop is theta_hat'G. An actuator and a sensor's lag are in series with it."""
    plant = replace(problems[2].plant, input=PlantInput(actuator=TransferFunction([50.0], [1.0, 50.0])))
    problem = replace(problems[2], plant=plant, sensor=Sensor(lag=0.03))
    theta_hat = np.array([0.3, 0.2])
    found = FrozenLoops(problem, NormalizedMrac(law=LeastSquares(covariance0=1.0))).at(theta_hat).response(W)
    A = plant.A_m + np.outer(plant.b, plant.theta)
    G = np.array([np.linalg.solve(1j * w * np.eye(2) - A, plant.b) for w in W])
    np.testing.assert_allclose(found, G @ theta_hat * 50 / (1j * W + 50) / (0.03j * W + 1), rtol=1e-9)


def pade_real_part(loop, delay):
    """The largest real part of the closed-loop poles, with a Pade approximation of order 12 for the delay."""
    num, den = control.pade(delay, 12)
    delayed = series(TransferFunction(np.array(num), np.array(den)).realise(), loop)
    return float(np.linalg.eigvals(sensitivity(delayed).A).real.max())


def with_error(loop, size):
    """The largest real part of the closed-loop poles with Delta_m = size times the derivative's realisation."""
    one_plus = TransferFunction(np.polyadd(DERIVATIVE.shape.den, size * DERIVATIVE.shape.num), DERIVATIVE.shape.den)
    return float(np.linalg.eigvals(sensitivity(series(one_plus.realise(), loop)).A).real.max())


@pytest.mark.parametrize(("error", "real_part"), [(DelayError(), pade_real_part), (DERIVATIVE, with_error)])
def test_the_limit_is_exact_and_the_small_gain_size_below_it(problems, error, real_part):
    checked = 0
    for order, problem in problems.items():
        for tau in (0.02, 0.1, 0.5):
            loops = FrozenLoops(problem, scheme(tau))
            found = tolerated(loops, error)
            loop = loops.at_theta
            for part in (0.1, 0.5, 0.99):  # sufficient: stable for every smaller size
                assert real_part(loop, part * found.small_gain) < 0
            assert found.small_gain <= found.limit * (1 + 1e-9)
            if np.isfinite(found.limit):
                checked += 1
                assert real_part(loop, 0.995 * found.limit) < 0 < real_part(loop, 1.005 * found.limit), (order, tau)
    assert checked >= 8


def test_small_gain_against_the_h_infinity_norm_and_a_dense_grid(problems):
    for problem in problems.values():
        loop = FrozenLoops(problem, scheme(0.05)).at_theta
        T = complementary_sensitivity(loop)
        norm = peak_gain(series(T, DERIVATIVE.shape.realise())).gain
        assert small_gain(loop, DERIVATIVE) == pytest.approx(1 / norm, rel=1e-5)  # the precision of peak_gain is 1e-6
        delay = small_gain(loop, DelayError())
        w = np.geomspace(1e-2, 1e3, 20_000)
        gain = np.abs(T.response(w))
        sizes = np.linspace(0.02, 1.0, 30)[:, None] * delay  # all smaller delays too
        peaks = (np.abs(np.exp(-1j * w * sizes) - 1) * gain).max(axis=1)
        assert (peaks[:-1] < 1).all()
        assert peaks[-1] == pytest.approx(1, abs=1e-3)


def test_over_the_known_set(section_v):
    for tau in (0.01, 0.08):
        loops = FrozenLoops(section_v, scheme(tau, c_0=[1.0, 1.0]))
        found = tolerated(loops, DelayError())
        rng = np.random.default_rng(3)
        each = [small_gain(loops.at(theta), DelayError()) for theta in rng.uniform(-5, 5, (10, 2))]
        corners = [small_gain(loops.at(np.array([a, b])), DelayError()) for a in (-5.0, 5.0) for b in (-5.0, 5.0)]
        assert min(corners) * 0.99 < found.over_set <= min(*corners, *each) * 1.01  # its grid is coarser
    slow = tolerated(FrozenLoops(section_v, scheme(0.5, c_0=[1.0, 1.0])), DelayError())
    assert slow.over_set == 0  # A_m + b (theta - theta_hat)' is unstable at a corner, and F is too slow to stabilise it
    assert np.linalg.eigvals(section_v.plant.A_m + np.outer(section_v.plant.b, [9.0, 2.0])).real.max() > 0
    assert (
        tolerated(FrozenLoops(replace(section_v, uncertainty=None), scheme(0.5, c_0=[1.0, 1.0])), DelayError()).over_set is None
    )


@pytest.mark.parametrize("theta_hat", [[4.0, -3.0], [4.5, -2.0]])
def test_simulation_with_frozen_estimates_is_lost_where_the_loop_says(section_v, theta_hat):
    """A gain of 1e-60 freezes the estimates. There is no command, so only the loop's own modes are excited."""
    controller = RobustMrac(c_0=[1.0, 1.0], tau=0.06, law=Gradient(gamma=1e-60), theta_hat0=theta_hat)
    limit = DelayError().limit(FrozenLoops(section_v, controller).at(np.array(theta_hat)))
    members = []
    for factor in (0.98, 1.02):
        plant = replace(section_v.plant, input=PlantInput(delay=factor * limit))
        members.append((replace(section_v, plant=plant, reference=Constant(0.0)), controller))
    quarters = simulate_ensemble(members, Simulation(t_end=100.0, dt=1e-3), quarters=True).quarters.max(axis=2)
    assert (np.diff(quarters[0]) < 0).all()
    assert (np.diff(quarters[1]) > 0).all() or np.isnan(quarters[1]).all()


def test_a_loop_that_is_unstable_by_itself_is_refused(section_v):
    """theta = (4, -3) needs feedback, which comes too late through an actuator far slower than the plant's unstable mode."""
    slow = PlantInput(actuator=TransferFunction([0.05], [1.0, 0.05]))
    problem = replace(section_v, plant=replace(section_v.plant, input=slow))
    loop = FrozenLoops(problem, scheme(0.1, c_0=[1.0, 1.0])).at_theta
    assert np.linalg.eigvals(sensitivity(loop).A).real.max() > 0
    assert "stable without modelling error" in refusal(lambda: small_gain(loop, DelayError()))


def test_refusals(section_v):
    def change(**settings):
        return replace(section_v, plant=replace(section_v.plant, **settings))

    controller = scheme(0.1, c_0=[1.0, 1.0])
    assert "delay" in refusal(lambda: FrozenLoops(change(input=PlantInput(delay=0.1)), controller))
    assert "saturation" in refusal(lambda: FrozenLoops(change(input=PlantInput(saturation=[-1.0, 1.0])), controller))
    squares = Polynomial(degree=2)
    nonlinear = replace(section_v.plant, regressor=squares, theta=np.zeros(squares.size(2)))
    problem = replace(section_v, plant=nonlinear, uncertainty=None)
    assert "phi(x) = x" in refusal(lambda: FrozenLoops(problem, controller))
    two = replace(section_v.plant, b=np.eye(2), theta=np.zeros(4))
    several = replace(problem, plant=two, reference_model=ReferenceModel(k_0=[[1.0], [0.0]]))
    assert "2 columns" in refusal(lambda: FrozenLoops(several, controller))
    assert "controller" in refusal(lambda: FrozenLoops(section_v, 3))
    assert "theta_hat" in refusal(lambda: FrozenLoops(section_v, controller).at(np.zeros(3)))
    assert "shape" in refusal(lambda: ScaledError(TransferFunction([1.0], [1.0, -1.0])))
    assert "shape" in refusal(lambda: ScaledError(TransferFunction([1.0, 0.0], [1.0])))
    held = PlantInput(multiplicative=TransferFunction([0.1], [1.0, 1.0]))
    assert "multiplicative" in refusal(lambda: DERIVATIVE.added(held, 0.1))
