"""The output-feedback problem with f(t, y) and disturbances at input and output, compared with SciPy; Rohrs' plant and
experiments."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat.adaptation.lyapunov import LyapunovLaw
from barbalat.cases.load import parse_case
from barbalat.controllers import Sampled
from barbalat.controllers.output.linear import LinearOutput
from barbalat.controllers.output.mrac import MracOutput
from barbalat.linear.margins import margins
from barbalat.linear.systems import TransferFunction
from barbalat.problem.measurement import Sensor
from barbalat.problem.output_feedback import OutputPlant, OutputProblem, OutputReferenceModel
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Constant, Sine
from barbalat.solvers.simulation import Simulation
from independent import refusal

TF = TransferFunction
W_M = OutputReferenceModel(transfer_function=TF([3.0], [1.0, 3.0]))
ROHRS = TF([458.0], [1.0, 31.0, 259.0, 229.0])


def problem(**settings):
    plant = OutputPlant(transfer_function=TF([2.0], [1.0, 1.0]), nonlinear="(0.5 + 0.3*cos(2*t))*sin(y)")
    return OutputProblem(plant=plant, reference_model=W_M, reference=Sine(1.0, 1.0), disturbance=Constant(0.2), **settings)


@pytest.mark.parametrize("lag", [0.0, 0.2])
def test_time_dependent_uncertainty_and_output_disturbance_against_scipy(lag):
    """The tolerance 1e-9 is for RK4 at h = 1e-3 with modes below 10 rad/s."""
    sensor = Sensor(lag=lag) if lag else None
    controller = LinearOutput(loop=TF([1.0], [1.0, 1.0]))
    found = simulate(problem(output_disturbance=Sine(0.5, 3.0), sensor=sensor), [controller], Simulation(t_end=8.0, dt=1e-3))
    run = found[controller.name]

    def slope(t, s):
        own, y_m, u, seen = s
        y = own + 0.5 * np.sin(3 * t)
        measured = seen if lag else y
        f = (0.5 + 0.3 * np.cos(2 * t)) * np.sin(own)
        return [-own + 2 * (u + 0.2 + f), -3 * y_m + 3 * np.sin(t), -u + y_m - measured, (y - seen) / (lag or 1.0)]

    expected = solve_ivp(slope, (0, 8), np.zeros(4), method="DOP853", rtol=1e-12, atol=1e-13, t_eval=run.t).y
    y = expected[0] + 0.5 * np.sin(3 * run.t)
    np.testing.assert_allclose(run.y, y, atol=1e-9)
    np.testing.assert_allclose(run.e[:, 0], y - expected[1], atol=1e-9)
    np.testing.assert_allclose(run.figures["max_abs_y"], np.abs(y).max(), rtol=1e-4)


def test_a_sampled_controller_measures_the_disturbed_output():
    """u = y is held for a long sample. Right after the sample at t = 1 it is y(1) including the disturbance."""
    controller = Sampled(controller=LinearOutput(loop=TF([-1.0], [1.0]), feedforward=TF([1e-9], [1.0])), sample_time=1.0)
    run = simulate(problem(output_disturbance=Constant(0.3)), [controller], Simulation(t_end=1.5, dt=1e-2))[controller.name]
    assert run.u[-1] == pytest.approx(run.y[np.searchsorted(run.t, 1.0)], abs=1e-8)


def test_the_case_file_says_the_same():
    text = """
        name = "c"
        [plant]
        transfer_function = { num = [2.0], den = [1.0, 1.0] }
        nonlinear = "(0.5 + 0.3*cos(2*t))*sin(y)"
        disturbance = { kind = "constant", amplitude = 0.2 }
        output_disturbance = { kind = "sine", amplitude = 0.5, frequency = 3.0 }
        [reference_model]
        transfer_function = { num = [3.0], den = [1.0, 3.0] }
        [reference]
        kind = "sine"
        amplitude = 1.0
        frequency = 1.0
        [simulation]
        t_end = 2.0
        dt = 1e-2
        [[controller]]
        name = "K"
        scheme = "linear"
        controller = { num = [1.0], den = [1.0, 1.0] }
    """
    case = parse_case(text, "c")
    (from_file,) = simulate(case.problem, case.controllers, case.simulation).values()
    controller = LinearOutput(loop=TF([1.0], [1.0, 1.0]), name="K")
    (from_python,) = simulate(problem(output_disturbance=Sine(0.5, 3.0)), [controller], case.simulation).values()
    assert from_file.y.tolist() == from_python.y.tolist()


@pytest.mark.parametrize("formula", ["t*", "z + y", "x1 + y", "open('f')", 3, "y**t", "sin(y)*T", ""])
def test_what_is_no_formula_is_refused(formula):
    message = refusal(lambda: OutputPlant(transfer_function=TF([2.0], [1.0, 1.0]), nonlinear=formula))
    assert "plant.nonlinear must be a formula in y and t" in message


def test_rohrs_plant_has_the_published_limit():
    """Proportional feedback destabilises at k = 17.03, omega = 16.09 rad/s (Astrom, Proc. 22nd IEEE CDC, 1983)."""
    found = margins(ROHRS.realise())
    assert found.gain_up == pytest.approx(17.03, abs=0.005)
    assert ROHRS.at(np.array([np.sqrt(259) * 1j]))[0] == pytest.approx(-1 / found.gain_up, rel=1e-9)
    assert np.sqrt(259) == pytest.approx(16.09, abs=0.005)


@pytest.mark.parametrize(("frequency", "bursts"), [(16.1, True), (8.0, False)])
def test_rohrs_second_experiment(frequency, bursts):
    """With a constant command and a sinusoidal output disturbance at 16.1 rad/s, k_y drifts until the loop bursts."""
    classical = MracOutput(order=1, relative_degree=1, sign=1, law=LyapunovLaw(gamma=1.0), theta_hat0=[-0.65, 1.14], name="c")
    given = OutputProblem(
        plant=OutputPlant(transfer_function=ROHRS),
        reference_model=W_M,
        reference=Constant(2.0),
        output_disturbance=Sine(0.5, frequency),
    )
    run = simulate(given, [classical], Simulation(t_end=100.0, dt=1e-3))["c"]
    assert (run.diverged_at is not None) == bursts
    k_y = run.theta_hat[:, 0]
    means = [k_y[(run.t >= start) & (run.t < start + 10)].mean() for start in range(0, 60, 10)]
    assert (np.diff(means) < -0.1).all()  # it drifts in both
    if bursts:
        assert k_y.min() < -17.03
