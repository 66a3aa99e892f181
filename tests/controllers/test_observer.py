"""State feedback of an observer's estimate, compared with SciPy's integration of the loop by hand, and margins compared with
eigenvalues."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_continuous_are, solve_discrete_are
from scipy.optimize import brentq

from barbalat import (
    Adrc,
    BaselineAlone,
    L1Adaptive,
    LinearFeedback,
    Mrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    RobustMrac,
    Sampled,
    Simulation,
    TransferFunction,
    certify,
    input_filter,
    simulate,
    simulate_ensemble,
)
from barbalat.cases.load import CaseText, parse_case
from barbalat.certificates.linear_loops.from_sample_to_sample import linearised
from barbalat.export.in_the_loop import simulate_export
from barbalat.laws import FixedSigma, LeastSquares
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.varied import VariedCase, VariedObjects
from barbalat.plants import (
    DerivativeObserver,
    Dropout,
    KalmanObserver,
    Labels,
    LqiBaseline,
    LuenbergerObserver,
    Noise,
    PiBaseline,
    PlantInput,
    Sensor,
    Shell,
    Truth,
)
from barbalat.signals import Sine
from independent import refusal, symbols_against_numbers

# two carts with a spring: the first cart's position and the spring's length are measured, and u pushes the first cart
A = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.0, 3.0, -0.4, 0.0], [0.0, -8.0, 0.4, -0.2]])
B = np.array([0.0, 0.0, 2.0, -2.0])
C = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])
POLES = (-1.5, -2.0, [-2.0, 2.0])
TRUE_A = A + np.outer(B, [0.2, -0.3, 0.1, 0.1]) + np.diag([0.0, 0.0, 0.0, -0.1])  # partly uncontrollable
X0 = np.array([0.1, -0.05, 0.2, 0.3])
COMMAND = Sine(amplitude=0.5, frequency=1.3)
T = 0.01
OBSERVERS = {
    "luenberger": LuenbergerObserver([-12.0, -14.0, [-10.0, 8.0]], measured=C),
    "kalman": KalmanObserver([0.0, 0.0, 4.0, 4.0], [1e-4, 2e-4], measured=C),
    "derivative": DerivativeObserver(40.0, measured=C),
}
SIMULATION = Simulation(t_end=4.0, dt=1e-3, record_points=400)


def posed(kind, **more):
    plant = Plant(A=A, b=B, poles=POLES, x0=X0, input=more.pop("input", None))
    known = ParameterBox(lower=plant.theta - 2.0, upper=plant.theta + 2.0)
    more = {"uncertainty": known, "truth": Truth(A=TRUE_A), "reference_model": ReferenceModel(2.0)} | more
    return Problem(plant=plant, reference=COMMAND, observer=OBSERVERS[kind], **more)


def test_the_gains_are_those_of_their_definition():
    """The Luenberger observer has the required eigenvalues, and exp(pole T) if sampled. The Kalman filter agrees with SciPy's
    solution of the Riccati equations."""
    fixed = {kind: posed(kind).observer for kind in OBSERVERS}
    wanted = np.sort_complex([-12.0, -14.0, -10.0 + 8.0j, -10.0 - 8.0j])
    for step, expected in ((None, wanted), (T, np.exp(wanted * T))):
        F = fixed["luenberger"].equations(X0, None, step).F
        np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(F)), np.sort_complex(expected), rtol=1e-6)
    Q, R = np.diag([0.0, 0.0, 4.0, 4.0]), np.diag([1e-4, 2e-4])
    P = solve_continuous_are(A.T, C.T, Q, R)
    np.testing.assert_allclose(fixed["kalman"].equations(X0, None, None).G, P @ C.T @ np.linalg.inv(R), rtol=1e-8)
    fine = np.linspace(0.0, T, 2001)
    drift = [expm(A * s) @ Q @ expm(A * s).T for s in fine]
    Q_d = np.trapezoid(drift, fine, axis=0)
    P = solve_discrete_are(expm(A * T).T, C.T, Q_d, R / T)
    M = P @ C.T @ np.linalg.inv(C @ P @ C.T + R / T)
    np.testing.assert_allclose(fixed["kalman"].equations(X0, None, T).G, M, rtol=1e-5)


class ByHand:
    """The observers by their definitions, with the package's gains, which another test checks."""

    def __init__(self, kind, step):
        self.kind, made = kind, posed(kind).observer.equations(X0, None, step)
        self.L = made.G
        self.z = np.array([X0[0], X0[1]]) if kind == "derivative" else np.array([X0[0], X0[1], 0.0, 0.0])

    def estimate(self, z, y):
        return np.concatenate([y, 40.0 * (y - z)]) if self.kind == "derivative" else z

    def rates(self, z, y, u):
        return 40.0 * (y - z) if self.kind == "derivative" else A @ z + B * u + self.L @ (y - C @ z)


@pytest.mark.parametrize("kind", OBSERVERS)
def test_mrac_on_the_estimate_is_what_scipy_integrates(kind):
    """The plant differs from the nominal one and has a sensor lag. Limits act on the plant and in the observer."""
    low, high = -1.0, 1.2
    problem = posed(kind, input=PlantInput(saturation=[low, high]), sensor=Sensor(lag=0.02))
    gamma, hand = 3.0, ByHand(kind, None)
    run = simulate(problem, [Mrac(gamma=gamma, projection=False)], SIMULATION)["MRAC"]
    A_m, P, l = problem.plant.A_m, problem.known.P, len(hand.z)  # noqa: E741
    starts = np.concatenate([X0, problem.known.x0, C @ X0, hand.z, np.zeros(4)])
    np.testing.assert_array_equal(problem.known.x0, [X0[0], X0[1], 0.0, 0.0])

    def rates(t, s):
        x, x_m, y, z, theta = s[:4], s[4:8], s[8:10], s[10 : 10 + l], s[10 + l :]
        x_hat, r = hand.estimate(z, y), COMMAND(np.array(t))
        u = 2.0 * r - theta @ x_hat
        v = np.clip(u, low, high)
        return np.concatenate([
            TRUE_A @ x + B * v, A_m @ x_m + B * 2.0 * r, (C @ x - y) / 0.02, hand.rates(z, y, v),
            gamma * ((x_hat - x_m) @ P @ B) * x_hat,
        ])  # fmt: skip

    s = solve_ivp(rates, (0.0, 4.0), starts, t_eval=run.t, method="DOP853", rtol=1e-10, atol=1e-12, max_step=0.01).y
    assert np.abs(np.clip(run.u, low, high) - run.u).max() > 0.1  # the limits act
    np.testing.assert_allclose(
        run.x, s[:4].T, atol=2e-6
    )  # where u reaches its limit, the error of a step of 1e-3 is of second order
    np.testing.assert_allclose(run.theta_hat, s[10 + l :].T, atol=2e-6)


@pytest.mark.parametrize("kind", OBSERVERS)
def test_a_sampled_observer_is_its_difference_equation(kind):
    """The observer is compared with the current estimator and Tustin's form of the derivative, along the exact motion under the
    held u."""
    problem = posed(kind)
    alone = Sampled(controller=BaselineAlone(nominal=problem.plant.theta), sample_time=T)
    run = simulate(problem, [alone], replace(SIMULATION, record_points=4001))["Baseline"]
    whole = np.zeros((5, 5))
    whole[:4, :4], whole[:4, 4] = A, B
    predicted = expm(whole * T)
    whole[:4, :4] = TRUE_A
    moved = expm(whole * T)
    hand, x, controls = ByHand(kind, T), X0, []
    z, y_before, u = hand.z, C @ X0, 0.0
    for k in range(400):
        y = C @ x
        if k and kind == "derivative":  # (z[k] - z[k-1])/T = 40 times the mean of y - z
            z = ((1 - 20.0 * T) * z + 20.0 * T * (y + y_before)) / (1 + 20.0 * T)
        elif k:
            z = predicted[:4, :4] @ z + predicted[:4, 4] * u
            z = z + hand.L @ (y - C @ z)
        u = 2.0 * COMMAND(np.array(k * T)) - problem.plant.theta @ hand.estimate(z, y)
        controls.append(float(u))
        x, y_before = moved[:4, :4] @ x + moved[:4, 4] * u, y
    np.testing.assert_allclose(run.u[::10][:400].reshape(-1), controls, atol=1e-9)


LOST = (5, 6, 7, 20, 50, 51)
"""Samples without a measurement."""


@pytest.mark.parametrize("kind", OBSERVERS)
def test_a_lost_sample_is_predicted_and_corrects_nothing(kind):
    """The reference is computed by hand, with the exact motion of the truth. Without a sample, x_hat moves by the nominal plant
    alone, and a derivative keeps its value."""
    times = [[k * T - T / 4, k * T + T / 4] for k in LOST]
    problem = replace(posed(kind), faults=(Dropout(times=times),))
    alone = Sampled(controller=BaselineAlone(nominal=problem.plant.theta), sample_time=T)
    run = simulate(problem, [alone], replace(SIMULATION, record_points=4001))["Baseline"]
    whole = np.zeros((5, 5))
    whole[:4, :4], whole[:4, 4] = A, B
    predicted = expm(whole * T)
    whole[:4, :4] = TRUE_A
    moved = expm(whole * T)
    hand, x, controls, u, u_held = ByHand(kind, T), X0, [], 0.0, 0.0
    x_hat, w = np.concatenate([C @ X0, [0.0, 0.0]]), C @ X0
    for k in range(100):
        y, seen = C @ x, x_hat[:2]
        if kind == "derivative" and k in LOST:
            x_hat, w = np.concatenate([seen + T * x_hat[2:], x_hat[2:]]), w + T * x_hat[2:]
        elif kind == "derivative":
            w = ((1 - 20.0 * T) * w + 20.0 * T * (y + seen)) / (1 + 20.0 * T) if k else w
            x_hat = np.concatenate([y, 40.0 * (y - w)])
        elif k:
            x_hat = predicted[:4, :4] @ x_hat + predicted[:4, 4] * u
            x_hat = x_hat if k in LOST else x_hat + hand.L @ (y - C @ x_hat)
        u_held = u_held if k in LOST else 2.0 * COMMAND(np.array(k * T)) - problem.plant.theta @ x_hat
        u = float(u_held)
        controls.append(u)
        x = moved[:4, :4] @ x + moved[:4, 4] * u
    np.testing.assert_allclose(run.u[::10][:100].reshape(-1), controls, atol=1e-9)


@pytest.mark.parametrize("kind", ("luenberger", "kalman"))
@pytest.mark.parametrize("delay", (0.4 * T, T, 2.3 * T))
def test_a_sampled_observer_contains_the_delay_of_the_input(kind, delay):
    """On the nominal plant with a measured x0 the run equals the run without an observer. The simulated plant may have a
    different delay."""
    still = np.array([0.1, -0.05, 0.0, 0.0])
    limits = PlantInput(saturation=[-0.4, 0.3], delay=delay)
    watched = replace(posed(kind, input=limits), truth=None)
    watched = replace(watched, plant=replace(watched.plant, x0=still))
    controller = Sampled(controller=Mrac(gamma=3.0), sample_time=T)
    a, b = (simulate(one, [controller], SIMULATION)["MRAC"] for one in (watched, replace(watched, observer=None)))
    assert np.abs(a.u).max() > 0.45
    np.testing.assert_allclose(a.x, b.x, atol=1e-10)
    later = watched.with_inputs(lambda path: replace(path, delay=delay + T))
    assert later.fixed_observer.delay == delay


def test_a_sampled_observer_contains_the_delay_of_two_inputs():
    b = np.column_stack([B, [0.0, 0.0, 0.0, 1.0]])
    plant = Plant(A_m=A - 2.0 * np.eye(4), b=b, theta=np.zeros((4, 2)), x0=[0.1, 0.2, 0.0, 0.0], input=PlantInput(delay=1.5 * T))
    model, commands = ReferenceModel([[1.0, 0.0], [0.0, 1.0]]), (COMMAND, Sine(amplitude=0.3, frequency=2.0))
    watched = Problem(plant=plant, reference_model=model, reference=commands, observer=OBSERVERS["kalman"])
    controller = Sampled(controller=Mrac(gamma=3.0), sample_time=T)
    a, b = (simulate(one, [controller], SIMULATION)["MRAC"] for one in (watched, replace(watched, observer=None)))
    np.testing.assert_allclose(a.x, b.x, atol=1e-10)


def test_an_exact_model_is_estimated_exactly_and_changes_nothing():
    """With a measured x0 the estimate equals the nominal plant's state, so the run equals the run without an observer."""
    still = np.array([0.1, -0.05, 0.0, 0.0])
    plant = replace(posed("kalman").plant, x0=still)
    for kind in ("luenberger", "kalman"):
        for controller in (Mrac(gamma=3.0), Sampled(controller=Mrac(gamma=3.0), sample_time=T)):
            watched = replace(posed(kind), plant=plant, truth=None)
            a = simulate(watched, [controller], SIMULATION)["MRAC"]
            b = simulate(replace(watched, observer=None), [controller], SIMULATION)["MRAC"]
            np.testing.assert_allclose(a.x, b.x, atol=1e-10)
    wrong = simulate(posed("kalman"), [Mrac(gamma=3.0)], SIMULATION)["MRAC"]
    right = simulate(replace(posed("kalman"), observer=None), [Mrac(gamma=3.0)], SIMULATION)["MRAC"]
    assert np.abs(wrong.x - right.x).max() > 1e-3


def schemes():
    law = LeastSquares(covariance0=10.0)
    return [
        Mrac(gamma=2.0, leakage=FixedSigma(0.1)), L1Adaptive(gamma=50.0, filter=input_filter(0.05)),
        RobustMrac(tau=0.1, law=law), LinearFeedback(TransferFunction([1.0], [0.05, 1.0])), Adrc(bandwidth=10.0),
    ]  # fmt: skip


@pytest.mark.parametrize("kind", OBSERVERS)
@pytest.mark.parametrize("controller", schemes(), ids=lambda one: one.name)
def test_equations_mean_the_same_in_symbols_and_numbers(kind, controller):
    for one in (controller, Sampled(controller=controller, sample_time=T)):
        symbols_against_numbers(ClosedLoop.of(posed(kind), one), 1.0)


class TestMargins:
    """The design's linear loop with known theta, u = k_0 r - theta'x_hat, written here by hand."""

    def loop(self, problem):
        made, theta = problem.observer.equations(X0, None, None), problem.plant.theta
        l = len(made.F)  # noqa: E741
        H = np.eye(4) if made.H is None else made.H
        D = np.zeros((4, 2)) if made.D is None else made.D
        of_x, of_z = -theta @ D @ C, -theta @ H  # u
        A_open = np.block([[A, np.zeros((4, l))], [made.G @ C + made.B @ of_x[None], made.F + made.B @ of_z[None]]])
        return A_open, np.concatenate([B, np.zeros(l)]), np.concatenate([of_x, of_z])

    @pytest.mark.parametrize("kind", OBSERVERS)
    def test_the_delay_and_gain_margins_are_where_the_loop_loses_stability(self, kind):
        problem = posed(kind, truth=None)
        found = certify(problem, [BaselineAlone(nominal=problem.plant.theta)], SIMULATION)["Baseline"]
        A_o, b, c = self.loop(problem)

        def response(w):
            return -c @ np.linalg.solve(1j * w * np.eye(len(b)) - A_o, b)

        w = np.geomspace(1e-3, 1e4, 200001)
        size = np.array([abs(response(one)) for one in w[::20]])
        at = [brentq(lambda s: abs(response(s)) - 1, w[::20][i], w[::20][i + 1]) for i in np.flatnonzero(np.diff(size > 1))]
        delays = [((np.angle(response(one)) + np.pi) % (2 * np.pi)) / one for one in at]
        assert found.values["delay_margin"] == pytest.approx(min(delays), rel=1e-6)
        for key, beside in (("gain_margin", 1.0001), ("gain_reduction_margin", 0.9999)):
            gain = found.values[key]
            if not gain or not np.isfinite(gain):
                continue
            outside, inside = (np.linalg.eigvals(A_o + k * np.outer(b, c)).real.max() for k in (gain * beside, gain / beside))
            assert inside < 0 < outside

    @pytest.mark.parametrize("kind", OBSERVERS)
    @pytest.mark.parametrize("lag", [0.0, 0.03])
    def test_the_sampled_loop_with_its_delay_loses_stability_at_its_margin(self, kind, lag):
        """The reference is given by the eigenvalues of the sampled-data loop of plant, lag, controller and observer, around whole
        samples of delay."""
        problem = posed(kind, truth=None, sensor=Sensor(lag=lag) if lag else None)
        alone = Sampled(controller=BaselineAlone(nominal=problem.plant.theta), sample_time=T)
        margin = certify(problem, [alone], SIMULATION)["Baseline"].values["delay_margin"]
        assert self.radius(problem, lag, int(margin / T)) < 1 < self.radius(problem, lag, int(margin / T) + 1)

    def radius(self, problem, lag, d):
        made, theta = problem.observer.equations(X0, None, T), problem.plant.theta
        l, n = len(made.F), 6 if lag else 4  # noqa: E741
        whole = np.zeros((n + 1, n + 1))
        whole[:4, :4], whole[:4, n] = A, B
        if lag:
            whole[4:6, :4], whole[4:6, 4:6] = C / lag, -np.eye(2) / lag
        step = expm(whole * T)
        Cy = np.hstack([np.zeros((2, 4)), np.eye(2)]) if lag else C
        H = np.eye(4) if made.H is None else made.H
        D = np.zeros((4, 2)) if made.D is None else made.D
        # s = [plant at this sample before u, z of the previous sample, u[-1], ..., u[-1-d]]
        size = n + l + d + 1
        M = np.zeros((size, size))
        z = np.zeros((l, size))
        z[:, :n], z[:, n : n + l], z[:, n + l] = made.G @ Cy, made.F, made.B[:, 0]
        y = np.zeros((2, size))
        y[:, :n] = Cy
        u = -theta @ (H @ z + D @ y)
        acting = u if d == 0 else np.eye(size)[n + l + d - 1]
        M[:n, :n] = step[:n, :n]
        M[:n] += np.outer(step[:n, n], acting)
        M[n : n + l], M[n + l] = z, u
        for i in range(d):
            M[n + l + 1 + i, n + l + i] = 1.0
        return np.abs(np.linalg.eigvals(M)).max()


def test_nothing_is_guaranteed_beside_an_observer():
    """One sentence states the reason. Without the observer the case has a bound."""
    problem = posed("kalman", truth=None)
    found = certify(problem, [Mrac(gamma=3.0), Sampled(controller=Mrac(gamma=3.0, name="sampled"), sample_time=T)], SIMULATION)
    for certificate in found.values():
        assert not certificate.guaranteed
        assert certificate.entry("error_bound").why == "no theorem covers adaptation with an observer"
        assert certificate.values["delay_margin"] > 0
    cells = [cell for column in found.table.columns for cell in column.cells.values()]
    assert not any(cell.kind == "guaranteed" for cell in cells)
    assert certify(replace(problem, observer=None), [Mrac(gamma=3.0)], SIMULATION)["MRAC"].guaranteed


def test_a_sampled_controller_needs_no_continuous_observer(monkeypatch):
    """A failing continuous Riccati equation is no reason to reject a sampled controller, neither in a run nor in a
    certificate."""

    def refused(self, plant):
        raise AssertionError("the continuous filter was formed")

    monkeypatch.setattr(KalmanObserver, "continuous", refused)
    problem = posed("kalman", truth=None, sensor=Sensor(noise=Noise(std=[1e-3, 1e-3], sample_time=T)))
    controllers = [
        Sampled(controller=one, sample_time=T) for one in (Mrac(gamma=3.0), L1Adaptive(gamma=9.0, filter=input_filter(0.1)))
    ]
    simulate(problem, controllers, replace(SIMULATION, t_end=0.5))
    found = certify(problem, controllers, SIMULATION)
    assert all(found[one.name].values["delay_margin_adapting"] > 0 for one in controllers)


def test_a_continuous_observer_says_that_it_leaves_the_delay_out():
    said = "the observer of a continuous controller does not include the input delay"
    plant = Plant(A=[[0.0, 1.0], [-2.0, -0.5]], b=[0.0, 1.0], poles=[-2.0, -3.0], input=PlantInput(delay=0.02))
    for kind, there in (
        (LuenbergerObserver([-8.0, -9.0], measured=[[1.0, 0.0]]), True),
        (DerivativeObserver(40.0, measured=[[1.0, 0.0]]), False),
    ):
        problem = Problem(plant=plant, observer=kind)
        found = certify(
            problem, [Mrac(gamma=1.0), Sampled(controller=Mrac(gamma=1.0, name="sampled"), sample_time=T)], SIMULATION
        )
        assert [any(said in one for one in found[name].notes) for name in ("MRAC", "sampled")] == [there, False]


def test_the_design_stays_where_the_plant_is_varied_and_knows_no_truth():
    problem = posed("luenberger")
    moved = replace(problem, plant=replace(problem.plant, theta=problem.plant.theta + 1.0))
    assert moved.observer is problem.observer
    np.testing.assert_array_equal(moved.observer.A, A)
    plant = Plant(A_m=[[0.0, 1.0], [-1.0, -1.0]], b=[0.0, 1.0], theta=[5.0, 5.0])
    design = LuenbergerObserver([-5.0, -6.0], measured=[[1.0, 0.0]])
    without = Problem(plant=plant, observer=design)
    np.testing.assert_array_equal(without.observer.A, plant.A_m)
    known = replace(without, observer=design, uncertainty=ParameterBox(lower=[0.0, -2.0], upper=[8.0, 0.0]))
    np.testing.assert_array_equal(known.observer.A, [[0.0, 1.0], [3.0, -2.0]])


@pytest.mark.parametrize("kind", OBSERVERS)
def test_exported_c_predicts_through_lost_samples_as_simulated(kind):
    """The case has a delay in the observer, bursts of lost samples, ranges and a longest outage."""
    labels = Labels(names=["place", "length", "rate", "length_rate"])
    shell = Shell(range={"length": [-2.0, 2.0]}, rate={"place": 50.0}, longest_outage=0.05, fallback="fade")
    problem = posed(kind, input=PlantInput(saturation=[-1.0, 1.2], delay=1.7 * T), labels=labels, shell=shell)
    problem = replace(problem, faults=(Dropout(share=0.3, burst=0.04, seed=1),))
    sampled = Sampled(controller=Mrac(gamma=3.0), sample_time=T)
    flown = simulate_export(problem, sampled, SIMULATION)
    assert flown.refused > 100 and not flown.differs_from(simulate(problem, [sampled], SIMULATION)["MRAC"])


@pytest.mark.parametrize("kind", OBSERVERS)
def test_exported_c_flies_as_simulated(kind):
    problem = posed(kind, input=PlantInput(saturation=[-1.0, 1.2]))
    for controller in (Mrac(gamma=3.0), L1Adaptive(gamma=50.0, filter=input_filter(0.05))):
        sampled = Sampled(controller=controller, sample_time=T)
        flown = simulate_export(problem, sampled, SIMULATION)
        assert not flown.refused and not flown.differs_from(simulate(problem, [sampled], SIMULATION)[controller.name])


def test_a_shell_and_faults_reach_the_measurement_and_the_observer():
    """With lost encoder samples the C in the case's shell equals the simulation bit for bit, and the run differs from the one
    without losses."""
    labels, T_n = Labels(names=["place", "length", "rate", "length_rate"]), T
    sensor = Sensor(noise=Noise(std=[1e-4, 2e-4], sample_time=T_n))
    problem = posed("kalman", labels=labels, sensor=sensor, shell=Shell(range={"length": [-2.0, 2.0]}))
    assert problem.measured_names == ("place", "length")
    faulty = replace(problem, faults=(Dropout(share=0.3, channel="length"),))
    sampled = Sampled(controller=Mrac(gamma=3.0), sample_time=T)
    good, bad = (simulate(one, [sampled], SIMULATION)["MRAC"] for one in (problem, faulty))
    assert np.abs(good.x - bad.x).max() > 1e-4
    found = simulate_export(faulty, sampled, SIMULATION)
    assert not found.differs_from(bad)
    said = refusal(lambda: replace(problem, faults=(Dropout(share=0.3, channel="rate"),)))
    assert "rate" in said and "place, length" in said
    said = refusal(lambda: replace(problem, sensor=Sensor(noise=Noise(std=[1e-4] * 4, sample_time=T_n))))
    assert "sensor.noise.std" in said


def test_members_of_an_ensemble_are_the_runs_by_themselves():
    problem, controller = posed("derivative"), Sampled(controller=Mrac(gamma=3.0), sample_time=T)
    truths = [Truth(A=TRUE_A + shift * np.outer(B, [0.3, 0.0, 0.0, 0.0])) for shift in (0.0, 1.0)]
    problems = [replace(problem, truth=truth) for truth in truths]
    found = simulate_ensemble([(one, controller) for one in problems], SIMULATION)
    for i, one in enumerate(problems):
        run = simulate(one, [controller], SIMULATION)["MRAC"]
        np.testing.assert_allclose(found.metrics.max_abs_e[i], run.figures["max_abs_e"], rtol=1e-9)


def test_a_path_to_the_design_makes_another_observer_and_one_to_the_plant_does_not():
    text = CASE.format(C="C = [[1, 0]]", observer='kind = "luenberger"\npoles = [-9.0, -8.0]')
    case = parse_case(text)
    paths = tuple(FieldPath.parse(text) for text in ("observer.poles[0]", "plant.A[1][0]"))
    objects = VariedObjects(case, paths, redesign=False).at([-20.0, -3.0]).problem
    file = VariedCase(CaseText(text), paths, redesign=False).at([-20.0, -3.0]).problem
    for problem in (objects, file):
        found = np.sort(np.linalg.eigvals(problem.observer.equations(np.zeros(2), None, None).F).real)
        np.testing.assert_allclose(found, [-20.0, -8.0], rtol=1e-9)
        np.testing.assert_array_equal(problem.observer.A, [[0.0, 1.0], [-2.0, -0.5]])
        np.testing.assert_array_equal(problem.dynamics.A, [[0.0, 1.0], [-3.0, -0.5]])


def test_a_baseline_takes_the_estimate_too():
    """An LQI on the estimate: SciPy integrates plant, observer and integral off the nominal plant."""
    plant = Plant(A=A, b=B, x0=X0, baseline=LqiBaseline(Q=[1.0, 1.0, 0.1, 0.1, 4.0], R=1.0, output=C[0]))
    problem = Problem(plant=plant, reference=COMMAND, truth=Truth(A=TRUE_A), observer=OBSERVERS["kalman"])
    run = simulate(problem, [BaselineAlone()], SIMULATION)["Baseline"]
    K, hand = plant.baseline.K[0], ByHand("kalman", None)

    def rates(t, s):
        x, z, xi = s[:4], s[4:8], s[8]
        u = -K[:4] @ z - K[4] * xi
        return np.concatenate([TRUE_A @ x + B * u, hand.rates(z, C @ x, u), [COMMAND(np.array(t)) - z[0]]])

    s = solve_ivp(rates, (0.0, 4.0), np.concatenate([X0, hand.z, [0.0]]), t_eval=run.t, rtol=1e-10, atol=1e-12).y
    np.testing.assert_allclose(run.x, s[:4].T, atol=1e-8)


def with_pi(kind, **more):
    """The first cart's measured position is held by a PI controller; the plant is damped, which makes this possible."""
    damped = A + np.outer(B, [-1.0, -0.5, -2.0, 0.5])
    plant = Plant(A=damped, b=B, x0=X0, baseline=PiBaseline(k_p=0.8, k_i=0.3, output=C[0]), input=more.pop("input", None))
    return Problem(plant=plant, reference=COMMAND, observer=OBSERVERS[kind], truth=Truth(A=TRUE_A - A + damped), **more)


@pytest.mark.parametrize("kind", ["luenberger", "kalman"])
def test_a_pi_controller_acts_on_the_measured_state_itself(kind):
    """The PI controller does not depend on the observer's estimate: SciPy integrates only the plant and the integral."""
    problem = with_pi(kind)
    run, true_A = simulate(problem, [BaselineAlone()], SIMULATION)["Baseline"], problem.simulated.A

    def rates(t, s):
        error = COMMAND(np.array(t)) - s[0]
        return np.concatenate([true_A @ s[:4] + B * (0.8 * error + 0.3 * s[4]), [error]])

    s = solve_ivp(rates, (0.0, 4.0), [*X0, 0.0], t_eval=run.t, rtol=1e-10, atol=1e-12).y
    np.testing.assert_allclose(run.x, s[:4].T, atol=1e-8)
    alone = replace(problem, observer=None)
    margins = [certify(one, [BaselineAlone()], SIMULATION)["Baseline"].values["delay_margin"] for one in (problem, alone)]
    np.testing.assert_allclose(*margins, rtol=1e-6)


@pytest.mark.parametrize("kind", ["luenberger", "kalman"])
def test_a_measured_state_is_sampled_or_predicted_in_simulation_and_c(kind):
    """The test has lost samples, a shell and a delay in the observer. Without losses, the PI and its margins are the same as
    without an observer."""
    sampled = Sampled(controller=BaselineAlone(), sample_time=T)
    problem = with_pi(
        kind, input=PlantInput(saturation=[-1.0, 1.2], delay=1.7 * T), shell=Shell(longest_outage=0.2, fallback="hold")
    )
    alone = replace(problem, observer=None)
    one, other = (simulate(each, [sampled], SIMULATION)["Baseline"] for each in (problem, alone))
    np.testing.assert_allclose(one.x, other.x, atol=1e-12)
    margins = [certify(each, [sampled], SIMULATION)["Baseline"].values["delay_margin"] for each in (problem, alone)]
    np.testing.assert_allclose(*margins, rtol=1e-6)
    lossy = replace(problem, faults=(Dropout(share=0.3, burst=0.04, seed=1),))
    for controller in (sampled, Sampled(controller=Mrac(gamma=3.0), sample_time=T)):
        result = simulate(lossy, [controller], SIMULATION)[controller.name]
        flown = simulate_export(lossy, controller, SIMULATION)
        assert flown.refused > 100 and not flown.differs_from(result)
        assert np.abs(result.x - one.x).max() > 1e-4


def test_a_measured_state_continues_as_predicted_through_a_lost_sample():
    """The state's component of x_hat is the sample if there is one, and otherwise the model's prediction."""
    made = with_pi("kalman").observer.equations(X0, None, T)
    plain = posed("kalman").observer
    unchanged = replace(with_pi("kalman").observer, direct=()).equations(X0, None, T)
    z, y, u = made.start, np.array([0.3, 0.1]), np.array([0.2])
    assert plain.direct == () and made.H[0] @ z == X0[0]
    taken = made.estimate(made.advance(z, u, y, False), y)
    filtered = unchanged.advance(unchanged.start, u, y, False)
    assert taken[0] == 0.3 and abs(filtered[0] - 0.3) > 1e-3
    np.testing.assert_array_equal(taken[1:], filtered[1:])
    lost = made.estimate(made.advance(z, u, y, True), y)
    np.testing.assert_allclose(lost, unchanged.advance(unchanged.start, u, y, True), rtol=1e-14)


PLANT = Plant(A_m=[[0.0, 1.0], [-1.0, -1.0]], b=[0.0, 1.0], theta=[0.0, 0.0])
LABELS = Labels(names=["angle", "rate"])


ENCODERS = {"Q": [0.0, 0.0, 10.0, 10.0], "R": [8.7e-14, 3.9e-10]}
"""Parameters of a cart-pendulum whose cart has an encoder with a resolution of 20 um. SciPy's continuous solver fails on them
without scaling."""


@pytest.mark.parametrize("step", (None, 0.002, 1e-5))
def test_a_fine_encoder_has_a_kalman_filter(step):
    """The filter's poles are those of the Hamiltonian matrix. With short samples the sampled filter has the same poles."""
    pendulum = [[0.0, 0, 1, 0], [0, 0, 0, 1], [0, 1.5, -15.0, -0.004], [0, 26.5, -34.0, -0.08]]
    plant = Plant(A=pendulum, b=[0.0, 0.0, 2.0, 4.5], poles=[-5.0, -6.0, -7.0, -8.0])
    observer = Problem(plant=plant, observer=KalmanObserver(**ENCODERS, measured=C)).observer
    found = observer.equations(X0, None, step)
    A, Q, R = np.array(pendulum), np.diag(ENCODERS["Q"]), np.diag(ENCODERS["R"])
    poles = np.linalg.eigvals(found.F)
    if step is None:
        # a filter's poles are the stable ones of the Hamiltonian matrix; a double integrator's are at (Q/R)^(1/4)
        expected = np.linalg.eigvals(np.block([[A.T, -C.T @ np.linalg.solve(R, C)], [-Q, -A]]))
        expected = expected[expected.real < 0]
        np.testing.assert_allclose(np.sort(np.abs(poles)), np.sort(np.abs(expected)), rtol=1e-6)
        np.testing.assert_allclose(np.abs(poles).max(), (10.0 / 8.7e-14) ** 0.25, rtol=0.02)
    else:
        assert np.abs(poles).max() < 1
        if step == 1e-5:
            slow = observer.equations(X0, None, None).F
            np.testing.assert_allclose(np.sort(np.abs(poles)), np.sort(np.abs(np.exp(np.linalg.eigvals(slow) * step))), rtol=1e-3)


def test_why_there_is_no_filter_is_told():
    """The message names an integrator that Q does not drive. If there is none, the parameters are the reason and not a mode."""
    plant = Plant(A=[[0.0, 0.0], [0.0, -1.0]], b=[1.0, 1.0], poles=[-1.0, -2.0])
    posed = Problem(plant=plant, observer=KalmanObserver([0.0, 1.0], 1.0, measured=[[1.0, 1.0]]))
    for step in (None, 0.01):
        said = refusal(lambda step=step: posed.observer.equations(np.zeros(2), None, step))
        assert "observer.Q does not give a steady-state filter: it does not drive the mode at 0" in said
    still = Problem(plant=plant, observer=KalmanObserver(1e-20, 1e20, measured=[[1.0, 1.0]]))
    assert "too badly conditioned" in refusal(lambda: still.observer.equations(np.zeros(2), None, 0.01))


@pytest.mark.parametrize(
    ("observer", "said"),
    [
        (LuenbergerObserver([-5.0], measured=["angle"]), "observer.poles must place 2 poles (a complex one counts twice), got 1"),
        (LuenbergerObserver([-5.0, 1.0], measured=["angle"]), "observer.poles must lie in Re s < 0, got 1"),
        (LuenbergerObserver([-5.0, -6.0]), "observer.measured is missing: give plant.C, or the labels"),
        (
            LuenbergerObserver([-5.0, -6.0], measured=["angel"]),
            "observer.measured names no state, got 'angel'; the states are angle",
        ),
        (LuenbergerObserver([-5.0, -6.0], measured=[[1.0]]), "observer.measured must have 2 columns, one for each state, got 1"),
        (LuenbergerObserver([-5.0, -6.0], measured=[[1.0, 0], [2.0, 0]]), "observer.measured must have independent rows"),
        (LuenbergerObserver([-5.0, -5.0, -5.0], measured=["angle"]), "observer.poles must place 2 poles"),
        (KalmanObserver([1.0], 1.0, measured=["angle"]), "observer.Q must have 2 entries, one for each state, got 1"),
        (KalmanObserver(1.0, 0.0, measured=["angle"]), "observer.R must be positive definite"),
        (KalmanObserver([-1.0, 1.0], 1.0, measured=["angle"]), "observer.Q must be positive semi-definite"),
        (
            DerivativeObserver(9.0, measured=["rate"]),
            "kind derivative does not give state 1, which is neither measured nor the rate",
        ),
        (DerivativeObserver(9.0, measured=[[2.0, 0.0]]), "observer.measured must have a single 1 in each row for derivatives"),
        (DerivativeObserver(9.0, measured=["angle", "rate"]), "nothing to differentiate, because all states are measured"),
    ],
)
def test_what_is_no_observer_is_told_in_one_sentence(observer, said):
    assert said in refusal(lambda: Problem(plant=PLANT, observer=observer, labels=LABELS))


def test_what_is_not_seen_is_told():
    plant = Plant(A_m=[[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, -1.0]], b=[1.0, 0.0, 1.0], theta=[0.0, 0.0, 0.0])
    design = LuenbergerObserver([-5.0, -6.0, -7.0], measured=[[0.0, 1.0, 0.0]])
    assert "must make the plant observable, but the mode at -1" in refusal(lambda: Problem(plant=plant, observer=design))
    Problem(plant=plant, observer=KalmanObserver(1.0, 1.0, measured=design.measured))  # a mode that decays need not be observable
    unstable = Plant(A=[[1.0, 0.0], [0.0, 0.0]], b=[1.0, 1.0], poles=[-1.0, -2.0])
    blind = KalmanObserver(1.0, 1.0, measured=[[0.0, 1.0]])
    assert "the mode at 1 is not visible in C" in refusal(lambda: Problem(plant=unstable, observer=blind))


CASE = """
name = "encoder"
[plant]
A = [[0, 1], [-2.0, -0.5]]
b = [0, 1.0]
{C}
[observer]
{observer}
[reference_model]
poles = [-3, -4]
follow = "x_1"
[reference]
kind = "sine"
amplitude = 1.0
frequency = 1.0
[simulation]
t_end = 2.0
dt = 1e-3
[[controller]]
scheme = "mrac"
gamma = 1.0
"""
POLES_OF_CASE = 'kind = "luenberger"\npoles = [[-8, 3]]'


def test_a_case_file_says_what_is_measured_in_either_place():
    with_C = parse_case(CASE.format(C="C = [[1, 0]]", observer=POLES_OF_CASE))
    with_labels = parse_case(CASE.format(C="", observer=POLES_OF_CASE + '\nmeasured = ["x_1"]'))
    for case in (with_C, with_labels):
        np.testing.assert_array_equal(case.problem.observer.C, [[1.0, 0.0]])
        assert case.problem.measured_names == ("x_1",)
    both = CASE.format(C="C = [[1, 0]]", observer=POLES_OF_CASE + "\nmeasured = [[1, 0]]")
    assert "observer.measured and plant.C are both given" in refusal(lambda: parse_case(both))
    neither = CASE.format(C="", observer=POLES_OF_CASE)
    assert "observer.measured is missing" in refusal(lambda: parse_case(neither))
    alone = CASE.format(C="C = [[1, 0]]", observer=POLES_OF_CASE).replace("[observer]\n" + POLES_OF_CASE, "")
    assert "plant.C declares the measurement, so state feedback needs [observer]" in refusal(lambda: parse_case(alone))


def test_the_keys_of_another_kind_are_told_in_one_line():
    kalman = CASE.format(C="C = [[1, 0]]", observer='kind = "luenberger"\nQ = [1.0, 1.0]\nR = 1e-6')
    said = refusal(lambda: parse_case(kalman))
    assert said == "observer.Q has no meaning for luenberger; observer.poles is missing; known here: kind, poles, measured"


def test_a_sampled_dynamic_baseline_has_its_margins_over_the_known_set():
    """The loop at a different theta is the loop of the plant with that theta. The state of the baseline does not change."""
    plant = Plant(A=A, b=B, x0=X0, baseline=LqiBaseline(Q=[1.0, 1.0, 0.1, 0.1, 4.0], R=1.0, output=C[0]))
    change = np.array([0.1, -0.2, 0.05, 0.1, 0.0])
    known = ParameterBox(lower=plant.theta - 2 * abs(change), upper=plant.theta + 2 * abs(change))
    problem = Problem(plant=plant, reference=COMMAND, observer=OBSERVERS["kalman"], uncertainty=known)
    controller = Sampled(controller=BaselineAlone(), sample_time=T)
    there = linearised(replace(problem, truth=Truth(A=A + np.outer(B, change[:4]))), controller).loop
    np.testing.assert_allclose(linearised(problem, controller).for_change(plant.b, change).A, there.A, atol=1e-12)
    found = certify(problem, [controller], SIMULATION)
    (loop,) = found[controller.name].values["margins_over_known_set"]
    assert 0 < loop["delay_margin"]["value"] <= found[controller.name].values["delay_margin"]
    (column,) = found.table.columns
    assert "over the known set" in column.cells["margins"].text
    assert "dynamic baseline" in column.cells["stability"].text and "sample_time" not in column.cells["stability"].text
