"""The MIT rule: the textbook's example, the gradient that it follows, and the loss of stability at a high gain or a large
command."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat import MitRule, Plant, Problem, ReferenceModel, certify, load_case, simulate
from barbalat.certificates.certificates import table_1
from barbalat.certificates.schemes.mit_rule import MARGIN
from barbalat.plants import PlantInput
from barbalat.signals import Constant, Square
from barbalat.solvers.simulation import Simulation
from independent import refusal

HALF_PERIOD = 10.0  # s, of the case's square wave


def textbook(gamma, until):
    """(y, y_m, theta_1, theta_2) after ``until`` s in Example 5.2, in the book's symbols and with a_m/(p + a_m) before u_c and
    y."""
    state = np.zeros(6)
    for k in range(round(until / HALF_PERIOD)):
        u_c = 1.0 if k % 2 == 0 else -1.0

        def rates(t, state, u_c=u_c):
            y, y_m, theta_1, theta_2, of_u_c, of_y = state
            e, u = y - y_m, theta_1 * u_c - theta_2 * y
            gains = -gamma * of_u_c * e, gamma * of_y * e
            return -y + 0.5 * u, -2 * y_m + 2 * u_c, *gains, -2 * of_u_c + 2 * u_c, -2 * of_y + 2 * y

        state = solve_ivp(rates, (0, HALF_PERIOD), state, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    return state[:4]


def test_the_textbook_s_first_order_plant():
    """The tolerance 1e-9 is for RK4 at 1 ms over 100 s, with motions on a scale of a second."""
    case = load_case("astrom-wittenmark")
    run = simulate(case.problem, case.controllers, case.simulation)["MIT rule"]
    y, y_m, theta_1, theta_2 = textbook(1.0, 100.0)
    assert [*run.x[-1], *run.e[-1]] == pytest.approx([y, y - y_m], abs=1e-9)
    assert [*run.reported["k_r_hat"][-1], *run.theta_hat[-1]] == pytest.approx([theta_1, theta_2], abs=1e-9)


def test_it_goes_down_the_gradient_of_the_squared_error(problems):
    """d(c'e)/dk is by central differences of runs with constant ideal gains. The tolerance 1e-4 is the h^2 of the differences."""
    problem, c, at = problems[2], np.array([1.0, 0.3]), Simulation(t_end=3.0, dt=1e-3)
    plant = replace(problem.plant, x0=np.zeros(2))
    problem, k_r, h = replace(problem, plant=plant, uncertainty=None), 2.0, 1e-3
    ideal = np.append(plant.theta, k_r)

    def error(gains):
        still = MitRule(gamma=1e-30, output=c, theta_hat0=gains[:2], k_r0=float(gains[2]))
        (run,) = simulate(problem, [still], at).values()
        return c @ run.e[-1], run

    gradient = [(error(ideal + h * d)[0] - error(ideal - h * d)[0]) / (2 * h) for d in np.eye(3)]
    state = error(ideal)[1]
    parts = state.loop.unpack(state.states[-1]).controller
    np.testing.assert_allclose(gradient, [*(-c @ parts.Psi), c @ parts.psi_r], atol=1e-4)


def feedforward_textbook(gamma, until, *, amplitude=1.0, k=1.0, k_0=2.0):
    """Example 5.1 in the book's symbols with y' = -y + k u, y_m' = -y_m + k_0 u_c, u = theta u_c, theta' = -gamma e y_m."""

    def rates(t, state):
        y, y_m, theta = state
        u_c = amplitude * np.sin(t)
        return -y + k * theta * u_c, -y_m + k_0 * u_c, -gamma * (y - y_m) * y_m

    return solve_ivp(rates, (0, until), np.zeros(3), method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]


def test_the_textbook_s_feedforward_gain():
    """The tolerance 1e-9 is for RK4 at 1 ms over 20 s. docs/plants.md states how far theta overshoots 2."""
    case = load_case("mit-feedforward")
    runs = simulate(case.problem, case.controllers, case.simulation)
    for gamma, largest in ((0.5, 2.0), (1.0, 2.53), (2.0, 3.09)):
        run, (y, y_m, theta) = runs[f"gamma = {gamma:g}"], feedforward_textbook(gamma, 20.0)
        assert [*run.x[-1], *run.e[-1], *run.reported["k_r_hat"][-1]] == pytest.approx([y, y - y_m, theta], abs=1e-9)
        assert not run.theta_hat.any()
        assert round(float(run.reported["k_r_hat"].max()), 2) == largest


def test_a_small_command_makes_it_slow_and_a_large_one_bursts():
    """The numbers of docs/plants.md follow from the textbook's equations. With a tenth of the command theta has not converged
    after 400 s."""
    assert round(feedforward_textbook(1.0, 400.0, amplitude=0.1)[2], 2) == 1.73
    case = load_case("mit-feedforward")
    large = replace(case.problem, reference=replace(case.problem.reference, amplitude=10.0))
    (run,) = simulate(large, [case.controllers[1]], case.simulation).values()
    assert round(float(run.reported["k_r_hat"].max())) == 23


@pytest.mark.parametrize("amplitude", [0.5, 2.0])
def test_its_speed_goes_with_the_squared_command(amplitude):
    """With gamma a^2 = 1 and a small gamma, theta after 20 s is exactly the value for gamma = 1 and a = 1, as e y_m is
    proportional to a^2."""
    assert feedforward_textbook(1 / amplitude**2, 20.0, amplitude=amplitude)[2] == pytest.approx(
        feedforward_textbook(1.0, 20.0)[2], abs=1e-9
    )
    case = load_case("mit-feedforward")
    quiet = replace(case.problem, reference=replace(case.problem.reference, amplitude=amplitude))
    law = MitRule(gamma=2.0 / amplitude**2, k_r0=0.0, feedforward_only=True)
    (run,) = simulate(quiet, [law], case.simulation).values()
    assert run.reported["k_r_hat"][-1, 0] == pytest.approx(feedforward_textbook(1.0, 20.0)[2], abs=1e-9)


def feedforward_alone(r, gamma, *, start=0.49, theta_hat0=(0.0, 0.0)):
    """The feedforward for k G(s) with G = 1/(s^2 + A_1 s + A_2), k = 2 and the model A_2 G under a constant command, where theta
    -> A_2/2."""
    plant = Plant(A_m=[[0.0, 1.0], [-A_2, -A_1]], b=[0.0, 1.0], theta=[0.0, 0.0], x0=[r, 0.0], input=PlantInput(gain=2.0))
    problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=A_2), reference=Constant(r))
    controller = MitRule(gamma=gamma, k_r0=start * A_2, theta_hat0=theta_hat0, feedforward_only=True)
    certificate = certify(problem, [controller], Simulation(t_end=1.0, dt=0.01))[controller.name]
    return problem, controller, certificate


@pytest.mark.parametrize(("r", "gamma"), [(1.0, 0.1), (3.5, 0.1), (0.1, 5.0)])
def test_the_largest_gain_of_a_feedforward_alone_is_routh_s(r, gamma):
    """The textbook's characteristic polynomial is s^3 + a_1 s^2 + a_2 s + k gamma u_c y_m, with y_m = r. Its gamma is the
    package's divided by k_0."""
    *_, certificate = feedforward_alone(r, gamma)
    stable_below = A_1 * A_2 / (2.0 * (gamma / A_2) * r * r)
    assert certificate.values[MARGIN] == pytest.approx(stable_below, rel=1e-9)


@pytest.mark.parametrize("factor", [0.85, 1.15])
def test_a_feedforward_alone_bursts_above_it(factor):
    *_, certificate = feedforward_alone(1.0, 0.1)
    assert grows(*feedforward_alone(1.0, 0.1 * factor * certificate.values[MARGIN])[:2]) == (factor > 1)


def test_with_all_its_gains_frozen_a_feedforward_is_no_loop():
    """The loop then tolerates any delay, but with an active law it has a finite margin."""
    case = load_case("mit-feedforward")
    found = certify(case.problem, case.controllers[:1], case.simulation)["gamma = 0.5"].values
    assert found["delay_margin"] is None and 0 < found["delay_margin_adapting"] < 10


def test_a_feedback_that_stays_wrong_has_no_such_margin():
    *_, certificate = feedforward_alone(1.0, 0.1, theta_hat0=(0.2, 0.0))
    assert "fixed at theta_hat0" in certificate.entry(MARGIN).why


A_1, A_2 = 1.2, 0.8  # of G = 1/(s^2 + A_1 s + A_2)


def at_constant_command(r, gamma, **more):
    """A second-order plant in equilibrium at the model's state with gains that are wrong by a thousandth, and certify's statement
    on the law."""
    plant = Plant(A_m=[[0.0, 1.0], [-A_2, -A_1]], b=[0.0, 1.0], theta=[0.5, -0.4], x0=[r, 0.0], input=PlantInput(gain=2.0))
    problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=A_2), reference=Constant(r))
    controller = MitRule(gamma=gamma, theta_hat0=[0.2501, -0.2], k_r0=A_2 / 2, **more)
    certificate = certify(problem, [controller], Simulation(t_end=1.0, dt=0.01))[controller.name]
    return problem, controller, certificate


def grows(problem, controller):
    """Whether e at the end of 400 s is larger than in the first 8 s."""
    (run,) = simulate(problem, [controller], Simulation(t_end=400.0, dt=0.01)).values()
    if run.diverged_at is not None:
        return True
    e = np.abs(run.e[:, 0])
    return e[4 * len(e) // 5 :].max() > e[: len(e) // 50].max()


def test_the_largest_gain_is_the_textbook_s_condition():
    """s^3 + a_1 s^2 + a_2 s + kappa is stable for kappa < a_1 a_2; kappa = omega gamma (x_1^2 + r^2)/a_2 at x_1 = r."""
    for r, gamma in ((1.0, 0.1), (3.0, 0.02)):
        *_, certificate = at_constant_command(r, gamma)
        kappa = 2.0 / A_2 * gamma * 2 * r**2
        assert certificate.values[MARGIN] == pytest.approx(A_1 * A_2 / kappa, rel=1e-9)


@pytest.mark.parametrize("factor", [0.85, 1.15])
def test_a_high_gain_loses_it(factor):
    """At the factors 0.85 and 1.15 the rate of decay or growth exceeds 0.01/s, over 400 s."""
    *_, certificate = at_constant_command(1.0, 0.1)
    assert grows(*at_constant_command(1.0, 0.1 * factor * certificate.values[MARGIN])[:2]) == (factor > 1)


def bursts(problem, controller, r):
    """Whether e stays above a tenth of the amplitude under a square wave. Otherwise it is below a thousandth."""
    square = replace(problem, reference=Square(amplitude=r, frequency=0.3))
    (run,) = simulate(square, [controller], Simulation(t_end=400.0, dt=0.01)).values()
    assert max(run.figures["tail_max_abs_e"]) > 0.1 * r or max(run.figures["tail_max_abs_e"]) < 1e-3 * r
    return max(run.figures["tail_max_abs_e"]) > 0.1 * r


def test_a_large_command_loses_it_and_normalisation_does_not():
    """The gain is the same for r = 1 and r = 2. The certificate predicts both results and guarantees neither."""
    runs = {(r, alpha): at_constant_command(r, 0.1, normalization=alpha) for r in (1.0, 2.0) for alpha in (None, 1.0)}
    lost = {key: bursts(problem, controller, key[0]) for key, (problem, controller, _) in runs.items()}
    assert lost == {(1.0, None): False, (2.0, None): True, (1.0, 1.0): False, (2.0, 1.0): False}
    assert {key: found.values[MARGIN] < 1 for key, (*_, found) in runs.items()} == lost
    for problem, controller, found in runs.values():
        assert not found.guaranteed and "error_bound" not in found.values
        (column,) = table_1(problem, [controller], {controller.name: found}).columns
        assert not any(cell.kind == "guaranteed" for cell in column.cells.values())
    assert any("unstable: Gamma" in note for note in runs[2.0, None][2].notes)


def test_a_first_order_law_has_no_largest_gain():
    case = load_case("astrom-wittenmark")
    found = certify(case.problem, case.controllers, case.simulation)["MIT rule"].entry(MARGIN)
    assert found.applies and found.value is None and found.why.startswith("unlimited")


def test_where_the_plant_is_another_the_margin_is_not_given(problems):
    plant = replace(problems[2].plant, input=PlantInput(delay=0.1))
    found = certify(replace(problems[2], plant=plant), [MitRule(gamma=1.0)], Simulation(t_end=1.0, dt=0.01))["MIT rule"]
    assert "delay 0.1 s" in found.entry(MARGIN).why
    rate = MitRule(gamma=1.0, output=[0.0, 1.0])  # G(0) = 0
    found = certify(problems[2], [rate], Simulation(t_end=1.0, dt=0.01))["MIT rule"]
    assert "is inactive" in found.entry(MARGIN).why


def test_what_does_not_fit_is_refused(problems):
    assert "normalization must be" in refusal(lambda: MitRule(gamma=1.0, normalization=0.0))
    assert "output" in refusal(lambda: MitRule(gamma=1.0, output=[1.0]).bind(problems[2].known))
