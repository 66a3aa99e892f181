"""Excitation, path length and time at the bounds, compared with closed forms and with records of every step."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid, trapezoid
from scipy.signal import lsim

from barbalat import (
    L1Adaptive,
    LinearFeedback,
    Mrac,
    NormalizedMrac,
    ParameterBox,
    Plant,
    Problem,
    RobustMrac,
    Sampled,
    Simulation,
    TransferFunction,
    input_filter,
    simulate,
)
from barbalat.laws import Gradient, LeastSquares
from barbalat.plants import Labels
from barbalat.problem.baseline import LqiBaseline, PidBaseline
from barbalat.problem.known_set import ParameterBall
from barbalat.problem.observer import LuenbergerObserver
from barbalat.run.results.adapting import UNEXCITED_RATIO, _gram, excitation, on_bounds, regressor_along, share_text
from barbalat.signals import Constant

CHATTERING = L1Adaptive(gamma=1e4, filter=input_filter(0.02))


def run(problem, controller, *, t_end=20.0, dt=1e-3, record_points=2000):
    return simulate(problem, [controller], Simulation(t_end=t_end, dt=dt, record_points=record_points))[controller.name]


def test_a_rotating_regressor_in_closed_form():
    """[3 sin wt, 2 cos wt], rotated by any angle, has the eigenvalues 9/2 and 2 over whole periods. The tolerance is 1e-5: the
    trapezoidal rule is exact, but a window ends at the nearest recorded instants, which differ by at most half a thousandth of
    the window."""
    t = np.linspace(0, 80, 8001)
    w, angle = 2 * np.pi, 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    phi = (turn @ np.array([3 * np.sin(w * t), 2 * np.cos(w * t)])).T[:, :, None]
    found = excitation(t, phi)
    assert found.window == 20.0
    assert found.tail == pytest.approx(2.0, rel=1e-5)
    assert found.level == pytest.approx(2.0, rel=1e-3)
    gram = turn @ np.diag([4.5, 2.0]) @ turn.T
    correlation = gram[0, 1] / np.sqrt(gram[0, 0] * gram[1, 1])
    assert found.conditioning == pytest.approx(1 - abs(correlation), rel=1e-4)
    assert found.fading == pytest.approx(1, rel=1e-2)
    assert found.sampling == pytest.approx((w * 0.01) ** 2, rel=1e-2)  # the change from instant to instant


def test_the_level_is_that_of_the_worst_window():
    """The regressor is excited only in the last half. Over the first windows the level is zero, in the tail it is 1/2."""
    t = np.linspace(0, 80, 8001)
    on = t >= 40
    found = excitation(t, np.stack([np.sin(np.pi * t) * on, np.cos(np.pi * t) * on], axis=1)[:, :, None])
    assert found.level == 0.0
    assert found.tail == pytest.approx(0.5, rel=1e-3)


def test_several_inputs_excite_every_channel_alike():
    """With Phi = phi x I the smallest eigenvalue equals the one for phi."""
    t = np.linspace(0, 80, 8001)
    phi = np.stack([np.sin(np.pi * t), np.cos(np.pi * t)], axis=1)
    Phi = np.einsum("ki,jl->kijl", phi, np.eye(3)).reshape(len(t), 6, 3)
    assert excitation(t, Phi).tail == pytest.approx(excitation(t, phi[:, :, None]).tail, rel=1e-12)


def test_a_coarse_record_is_noticed():
    t = np.linspace(0, 100, 201)
    phi = np.stack([np.sin(5.9 * t), np.cos(6.2 * t)], axis=1)[:, :, None]  # two instants in each period, so it is aliased
    fine = np.linspace(0, 100, 20001)
    exact = excitation(fine, np.stack([np.sin(5.9 * fine), np.cos(6.2 * fine)], axis=1)[:, :, None])
    found = excitation(t, phi)
    assert 0.1 < abs(found.tail / exact.tail - 1) < found.sampling
    assert exact.sampling < 1e-2


@pytest.mark.parametrize("controller", [CHATTERING, Mrac(gamma=1.0), Sampled(controller=Mrac(gamma=100.0), sample_time=5e-3)])
def test_path_and_bounds_against_every_step(section_v, controller):
    """The path of the decimated record equals the path over all steps, and its fractions enclose the true ones."""
    every, decimated = (run(section_v, controller, record_points=n).adapting for n in (20_000, 300))
    record = run(section_v, controller, record_points=20_000)
    moves = np.abs(np.diff(record.theta_hat, axis=0))
    moves = moves[:-1] if isinstance(controller, Sampled) else moves  # its sample at t_end has no further effect
    np.testing.assert_allclose(decimated.path, moves.sum(axis=0), rtol=1e-9)
    np.testing.assert_allclose(decimated.net, record.theta_hat[-1] - record.theta_hat[0], atol=1e-9)
    on = (np.abs(record.theta_hat[:-1]) == 5.0).mean(axis=0)
    np.testing.assert_allclose(every.on_bounds.least, on, atol=1e-12)
    np.testing.assert_allclose(every.on_bounds.most, on, atol=1e-12)
    assert (decimated.on_bounds.least <= on + 1e-12).all() and (on <= decimated.on_bounds.most + 1e-12).all()
    met = np.abs(record.theta_hat) == 5.0
    first = np.where(met.any(axis=0), record.t[met.argmax(axis=0)], np.nan)
    interval = np.diff(run(section_v, controller, record_points=300).t).max()
    np.testing.assert_array_equal(np.isnan(decimated.on_bounds.first), np.isnan(first))
    assert not (np.abs(decimated.on_bounds.first - first) > interval).any()  # NaN is not


def test_what_is_thrown_from_bound_to_bound_is_said(section_v):
    found = run(section_v, CHATTERING).adapting
    assert any("both of its bounds" in warning for warning in found.warnings)
    calm = run(section_v, Mrac(gamma=10.0), dt=1e-4).adapting
    assert calm.warnings == ()


def test_what_sits_on_a_bound_is_said(section_v):
    """The true value [4, -3] is outside the box, so the estimates stay at its bounds."""
    problem = replace(section_v, uncertainty=ParameterBox(lower=[-1, -1], upper=[1, 1]))
    found = run(problem, Mrac(gamma=0.1)).adapting
    assert (found.on_bounds.least > 0.5).any()
    assert any("is at its projection bounds" in warning for warning in found.warnings)
    ball = run(replace(section_v, uncertainty=ParameterBall(center=[0, 0], radius=1.0)), Mrac(gamma=0.1)).adapting
    assert ball.on_bounds is None and ball.on_sphere > 0.5
    assert any("surface of the known set" in warning for warning in ball.warnings)


def test_what_never_adapts_is_said(section_v):
    stable = replace(section_v, plant=replace(section_v.plant, theta=[-1.0, -1.0]))  # without help of the adaptation
    found = run(stable, Mrac(gamma=1e-9)).adapting
    assert any("hardly adapts" in warning for warning in found.warnings)
    at_the_truth = run(stable, Mrac(gamma=1e-9, theta_hat0=[-1.0, -1.0])).adapting
    assert not any("hardly adapts" in warning for warning in at_the_truth.warnings)


def test_a_constant_command_excites_one_direction(section_v):
    found = run(replace(section_v, reference=Constant(1.0)), Mrac(gamma=10.0), t_end=200.0).adapting
    assert found.excitation.conditioning < UNEXCITED_RATIO
    assert any("does not excite every direction" in warning for warning in found.warnings)
    assert not run(section_v, Mrac(gamma=10.0), dt=1e-4).adapting.excitation.conditioning < UNEXCITED_RATIO


def test_a_regressor_that_dies_out_is_said(section_v):
    found = run(replace(section_v, reference=Constant(0.0)), Mrac(gamma=10.0), t_end=200.0).adapting
    assert any("died out" in warning for warning in found.warnings)


@pytest.mark.parametrize("law", [Gradient(gamma=10.0), LeastSquares(covariance0=500.0)])
def test_the_normalised_regressor_is_the_filtered_state(section_v, law):
    """phi = W_m(s)[x]/m_s is computed by an independent simulation with the recorded x. The tolerance 1e-5 is for the linear
    interpolation of 20,000 points."""
    result = run(section_v, NormalizedMrac(c_0=[1.0, 1.0], law=law), record_points=20_000)
    plant = section_v.plant
    system = (plant.A_m, plant.b[:, None], np.array([[1.0, 1.0]]), np.zeros((1, 1)))
    phi = np.stack([lsim(system, x, result.t)[1] for x in result.x.T], axis=1)
    phi /= np.sqrt(1 + np.sum(phi**2, axis=1))[:, None]
    own, found = excitation(result.t, phi[:, :, None]), result.adapting.excitation
    assert found.tail == pytest.approx(own.tail, rel=1e-5) and found.level == pytest.approx(own.level, rel=1e-5)


def test_the_lyapunov_laws_regressor_is_the_state(section_v):
    for controller in (Mrac(gamma=1.0), L1Adaptive(gamma=1.0, filter=input_filter(0.02))):
        result = run(section_v, controller)
        assert result.adapting.excitation == excitation(result.t, result.x[:, :, None])


def test_schemes_that_estimate_nothing_and_runs_that_diverge(section_v):
    diverged = run(section_v, L1Adaptive(gamma=1e4, filter=input_filter(0.02), projection=False))
    assert diverged.diverged_at is not None
    assert diverged.adapting.on_bounds is None and np.isfinite(diverged.adapting.path).all()
    fixed = LinearFeedback(controller=TransferFunction([1.0], [0.1, 1.0]))
    assert run(section_v, fixed, t_end=1.0).adapting is None


def test_a_robust_mrac_settles(section_v):
    found = run(section_v, RobustMrac(tau=0.5, c_0=[1.0, 1.0], law=LeastSquares(covariance0=500.0)), t_end=60.0).adapting
    np.testing.assert_allclose(found.net, [4.0, -3.0], atol=1e-3)
    assert (found.tail_path < 1e-3 * found.path).all()
    assert found.warnings == ()


def test_shares_are_rounded_outward():
    assert share_text(0.0, 0.0) == "0 %"
    assert share_text(0.5201, 0.5399) == "52 to 54 %"
    assert share_text(1.0, 1.0) == "100 %"


def test_the_excitation_of_a_large_regressor_takes_no_outer_products_and_is_the_integral():
    """The excitation is compared with SciPy's trapezoidal rule for each entry, for two inputs on an uneven grid."""
    random = np.random.default_rng(1)
    t = np.sort(random.uniform(0.0, 3.0, 60))
    phi = random.normal(size=(60, 5, 2))
    products = phi @ phi.transpose(0, 2, 1)
    expected = np.array([[trapezoid(products[:, i, j], t) for j in range(5)] for i in range(5)]) / (t[-1] - t[0])
    assert np.allclose(_gram(t, phi), expected, rtol=1e-12, atol=1e-14)
    tracemalloc.start()
    _gram(np.linspace(0.0, 1.0, 400), random.normal(size=(400, 300, 1)))
    assert tracemalloc.get_traced_memory()[1] < 8 * 400 * 300 * 300 / 4  # four copies of the regressor, not its products
    tracemalloc.stop()


def around(controller, baseline, observer=None):
    """A pendulum with a dynamic baseline, without noise."""
    plant = Plant(A=[[0, 1], [-3.0, -0.2]], b=[0, 2.0], x0=[0.1, 0.3], baseline=baseline)
    problem = Problem(
        plant=plant, reference=Constant(0.5), observer=observer, uncertainty=box_around(plant), labels=Labels(names=("y", "v"))
    )
    return run(problem, controller, t_end=4.0, dt=1e-3, record_points=4000)


def box_around(plant):
    return ParameterBox(lower=plant.theta - 0.5, upper=plant.theta + 0.5)


LQI = LqiBaseline(Q=[10, 1, 20], R=1.0, output=[1, 0])
PID = PidBaseline(k_p=8.0, k_i=6.0, k_d=4.0, T_f=0.05, output=[1, 0])
LUENBERGER = LuenbergerObserver(poles=(-20.0, -25.0), measured=("y",))


def test_the_regressor_beside_a_baseline_contains_its_integral():
    """The third estimate belongs to the integral of r - y, which is computed by the trapezoidal rule along the record."""
    found = around(Mrac(gamma=5.0), LQI)
    phi = regressor_along(found.loop, found.states, found.x, found.u)[:, :, 0]
    assert phi.shape[1] == found.theta_hat.shape[1] == 3
    np.testing.assert_array_equal(phi[:, :2], found.x)
    np.testing.assert_allclose(phi[:, 2], cumulative_trapezoid(0.5 - found.x[:, 0], found.t, initial=0.0), atol=1e-6)


@pytest.mark.parametrize("baseline", [LQI, PID])
@pytest.mark.parametrize("sample_time", [None, 0.01])
def test_excitation_beside_an_observer_is_that_of_the_estimate(baseline, sample_time):
    """The rate is not measured. The observer starts at 0 and follows within 0.5 s, which is ten times its slower time
    constant."""
    law = RobustMrac(tau=0.1, law=Gradient(gamma=1.0)), Mrac(gamma=1.0)
    for one in law:
        found = around(one if sample_time is None else Sampled(one, sample_time), baseline, LUENBERGER)
        phi = regressor_along(found.loop, found.states, found.x, found.u)
        assert phi.shape[1] == found.theta_hat.shape[1] and found.adapting.excitation is not None
    late = found.t > 0.5
    np.testing.assert_allclose(phi[late, 1, 0], found.x[late, 1], atol=0.1 * np.abs(found.x[:, 1]).max())
    assert np.abs(phi[~late, 1, 0] - found.x[~late, 1]).max() > 1e-4


def test_a_share_of_the_time_is_at_most_100_percent():
    """Because of rounding, the weights of the intervals add up to more than 1; this must not be reported as 101 %."""
    random, box = np.random.default_rng(0), ParameterBox(lower=[-1.0], upper=[1.0])
    t = next(
        t
        for t in (np.cumsum(random.uniform(0.1, 1.0, 200)) for _ in range(1000))
        if (np.diff(t) / (t[-1] - t[0])) @ np.ones(199) > 1
    )
    found = on_bounds(box, t, np.ones((199, 1)), np.ones((199, 1)))
    assert found.least == found.most == 1.0
    assert "101" not in share_text(0.9, float(found.most[0])) and "100" in share_text(0.9, float(found.most[0]))
