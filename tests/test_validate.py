"""Bad input is always an InputError of one sentence with the field and the value."""

from __future__ import annotations

import warnings

import casadi as ca
import control
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from barbalat.adaptation.law import Normalization
from barbalat.adaptation.laws import Gradient, LeastSquares
from barbalat.controllers import L1Adaptive, Mrac, NormalizedMrac, RobustMrac
from barbalat.laws import (
    CompositeLearning,
    DeadZone,
    EpsilonModification,
    FixedSigma,
    IntegralCost,
    LeastSquaresBounded,
    LeastSquaresBoundedGain,
    LeastSquaresForgetting,
    LeastSquaresResetting,
    SwitchingSigma,
)
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.state_feedback import ParameterBall, ParameterBox, Plant, Problem, ReferenceModel
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Chirp, Constant, Recorded, Sine, Sines, Square, Step, Steps
from barbalat.solvers import RK4
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError
from independent import refusal

A_M = [[0.0, 1.0], [-0.3, -1.0]]
LAW = LeastSquares(covariance0=500.0)


def plant(**changes):
    return Plant(**({"A_m": A_M, "b": [0.0, 1.0], "theta": [4.0, -3.0], "x0": [1.0, 1.0]} | changes))


def simulation(**changes):
    return Simulation(**({"t_end": 1.0, "dt": 0.01} | changes))


def l1(num, den, **changes):
    return L1Adaptive(gamma=10.0, filter=TransferFunction(num, den), **changes)


def bind(controller, section_v):
    return controller.bind(section_v.known)


# the input, and the fragments that the sentence must contain: the field, the value
REFUSED = {
    "A_m not square": (lambda p: plant(A_m=[[0, 1, 2], [3, 4, 5]]), "plant.A_m", "2 x 3"),
    "A_m a vector": (lambda p: plant(A_m=[-1.0, -2.0]), "plant.A_m", "[-1.0, -2.0]"),
    "A_m empty": (lambda p: plant(A_m=[]), "plant.A_m", "[]"),
    "A_m ragged": (lambda p: plant(A_m=[[0, 1], [2]]), "plant.A_m", "[[0, 1], [2]]"),
    "A_m of text": (lambda p: plant(A_m=[["0", "1"], ["2", "3"]]), "plant.A_m", "'0'"),
    "A_m complex": (lambda p: plant(A_m=[[0, 1], [-1, -1j]]), "plant.A_m", "1j"),
    "A_m with NaN": (lambda p: plant(A_m=[[0, 1], [np.nan, -1]]), "plant.A_m", "nan"),
    "A_m with infinity": (lambda p: plant(A_m=[[0, 1], [-np.inf, -1]]), "plant.A_m", "-inf"),
    "A_m a list of matrices": (lambda p: plant(A_m=[np.zeros((2, 2)), np.zeros((2, 2))]), "plant.A_m", "2 x 2 x 2"),
    "A_m unstable": (lambda p: plant(A_m=[[0, 1], [0.25, 0]]), "plant.A_m", "0.5"),
    "A_m oscillating": (lambda p: plant(A_m=[[0, 1], [-1, 0]]), "plant.A_m", "Hurwitz"),
    "A_m integrating": (lambda p: plant(A_m=[[0, 1], [0, -1]]), "plant.A_m", "Hurwitz"),
    "b too long": (lambda p: plant(b=[0.0, 1.0, 2.0]), "plant.b", "[0.0, 1.0, 2.0]"),
    "b with a row too many": (lambda p: plant(b=[[0.0, 1.0], [1.0, 0.0], [0.0, 0.0]]), "plant.b", "3 x 2"),
    "b symbolic": (lambda p: plant(b=ca.SX.sym("b", 2)), "plant.b", "b_0"),
    "b complex": (lambda p: plant(b=[0, 2j]), "plant.b", "2j"),
    "b zero": (lambda p: plant(b=[0.0, 0.0]), "plant.b", "controllable"),
    "uncontrollable mode": (lambda p: plant(A_m=[[-1, 0], [0, -2]]), "controllable", "-1"),
    "theta too short": (lambda p: plant(theta=[4.0]), "plant.theta", "[4.0]"),
    "theta with NaN": (lambda p: plant(theta=[4.0, np.nan]), "plant.theta", "nan"),
    "theta missing": (lambda p: plant(theta=None), "plant.theta", "None"),
    "x0 a number": (lambda p: plant(x0=1.0), "plant.x0", "1.0"),
    "x0 ragged": (lambda p: plant(x0=[[1.0], [1.0, 2.0]]), "plant.x0", "[[1.0], [1.0, 2.0]]"),
    "unmatched": (lambda p: Plant(A=[[1, 1], [-1, -1]], A_m=A_M, b=[0, 1]), "plant.A - reference_model.A_m", "1"),
    "matched, b zero": (lambda p: Plant(A=A_M, A_m=A_M, b=[0, 0]), "plant.b", "zero"),
    "k_0 text": (lambda p: ReferenceModel(k_0="4"), "reference_model.k_0", "'4'"),
    "k_0 infinite": (lambda p: ReferenceModel(k_0=np.inf), "reference_model.k_0", "inf"),
    "k_0 beyond a double": (lambda p: ReferenceModel(k_0=10**400), "reference_model.k_0", "1000"),
    "box empty": (lambda p: ParameterBox(lower=[-5, 6], upper=[5, 5]), "uncertainty.lower", "6 > 5"),
    "box lopsided": (lambda p: ParameterBox(lower=[-5, -5], upper=[5]), "uncertainty.upper", "[5]"),
    "box infinite": (lambda p: ParameterBox(lower=[-5, -np.inf], upper=[5, 5]), "uncertainty.lower", "-inf"),
    "box of another size": (
        lambda p: Problem(plant=plant(), uncertainty=ParameterBox(lower=[-1], upper=[1])),
        "uncertainty",
        "1",
    ),
    "reference a number": (lambda p: Problem(plant=plant(), reference=50.0), "reference", "50.0"),
    "reference a plain function": (lambda p: Problem(plant=plant(), reference=np.sin), "reference", "sin"),
    "reference a class": (lambda p: Problem(plant=plant(), reference=Sine), "reference", "Sine"),
    "disturbance text": (lambda p: Problem(plant=plant(), disturbance="step"), "disturbance", "'step'"),
    "plant missing": (lambda p: Problem(plant=None), "plant", "None"),
    "filter improper": (lambda p: l1([1, 0, 1], [1, 1]), "filter", "proper"),
    "filter only proper": (lambda p: l1([1, 1], [2, 1]), "filter", "strictly proper"),
    "filter unstable": (lambda p: l1([-1], [1, -1]), "filter", "stable"),
    "filter integrating": (lambda p: l1([1], [1, 0]), "filter", "stable"),
    "filter without unit gain": (lambda p: l1([2], [1, 1]), "filter", "got 2"),
    "filter zero": (lambda p: l1([0], [1, 1]), "filter", "got 0"),
    "filter den zero": (lambda p: l1([1], [0, 0]), "den", "[0, 0]"),
    "filter a number": (lambda p: L1Adaptive(gamma=1.0, filter=0.02), "filter", "0.02"),
    "filter of two inputs": (
        lambda p: L1Adaptive(gamma=1.0, filter=control.ss(-np.eye(2), np.eye(2), np.eye(2), 0)),
        "filter",
        "2",
    ),
    "filter discrete": (lambda p: L1Adaptive(gamma=1.0, filter=control.tf([0.5], [1, -0.5], 0.1)), "filter", "0.1"),
    "filter frequency data": (lambda p: L1Adaptive(gamma=1.0, filter=control.frd([1, 2], [1, 2])), "filter", "FrequencyResponse"),
    "kappa negative": (lambda p: input_filter(-0.02), "kappa", "-0.02"),
    "kappa denormal": (lambda p: input_filter(1e-320), "den", "e-320"),
    "gamma zero": (lambda p: Mrac(gamma=0.0), "gamma", "0.0"),
    "gamma negative": (lambda p: Mrac(gamma=-1), "gamma", "-1"),
    "gamma NaN": (lambda p: L1Adaptive(gamma=np.nan, filter=None), "gamma", "nan"),
    "gamma true": (lambda p: Mrac(gamma=True), "gamma", "True"),
    "theta_hat0 outside": (lambda p: bind(Mrac(gamma=1.0, theta_hat0=[0.0, 5.5]), p), "theta_hat0", "5.5"),
    "theta_hat0 too short": (lambda p: bind(Mrac(gamma=1.0, theta_hat0=[0.0]), p), "theta_hat0", "0."),
    "theta_hat0 NaN": (lambda p: bind(RobustMrac(tau=1.0, law=LAW, theta_hat0=[0.0, np.nan]), p), "theta_hat0", "nan"),
    "projection text": (lambda p: bind(Mrac(gamma=1.0, projection="no"), p), "projection", "'no'"),
    "projection without box": (
        lambda p: Mrac(gamma=1.0, projection=True).bind(Problem(plant=plant()).known),
        "projection",
        "uncertainty",
    ),
    "c_0 zero": (lambda p: bind(RobustMrac(c_0=[0, 0], tau=0.5, law=LAW), p), "c_0", "[0.0, 0.0]"),
    "c_0 with a zero at the origin": (lambda p: bind(RobustMrac(c_0=[0, 1], tau=0.5, law=LAW), p), "c_0", "minimum phase"),
    "c_0 not minimum phase": (lambda p: bind(RobustMrac(c_0=[-2, 1], tau=0.5, law=LAW), p), "c_0", "2"),
    "c_0 of the normalised MRAC": (lambda p: bind(NormalizedMrac(c_0=[-2, 1], law=LAW), p), "c_0", "2"),
    "c_0 too long": (lambda p: bind(RobustMrac(c_0=[1, 1, 1], tau=0.5, law=LAW), p), "c_0", "1"),
    "tau zero": (lambda p: RobustMrac(tau=0.0, law=LAW), "tau", "0.0"),
    "law text": (lambda p: RobustMrac(tau=0.5, law="least-squares"), "law", "'least-squares'"),
    "law a class": (lambda p: NormalizedMrac(law=LeastSquares), "law", "LeastSquares"),
    "normalization missing": (lambda p: RobustMrac(tau=0.5, law=LAW, normalization=None), "normalization", "None"),
    "alpha_0 negative": (lambda p: Normalization(alpha_0=-1.0), "alpha_0", "-1"),
    "delta_0 zero": (lambda p: Normalization(delta_0=0.0), "delta_0", "0"),
    "covariance0 indefinite": (lambda p: LeastSquares(covariance0=[[1.0, 2.0], [2.0, 1.0]]), "law.covariance0", "[2.0, 1.0]"),
    "covariance0 lopsided": (lambda p: LeastSquares(covariance0=[[1.0, 2.0], [0.0, 1.0]]), "law.covariance0", "symmetric"),
    "gain diagonal with a zero": (lambda p: Mrac(gamma=[1.0, 0.0]), "gamma", "[1.0, 0.0]"),
    "gain too long": (lambda p: bind(Mrac(gamma=[1.0, 1.0, 1.0]), p), "gamma", "2 parameters"),
    "ball without a radius": (lambda p: ParameterBall(center=[0, 0], radius=0.0), "uncertainty.radius", "0.0"),
    "ball too small": (
        lambda p: Problem(plant=plant(), uncertainty=ParameterBall(center=[0], radius=1.0)),
        "uncertainty.center",
        "1",
    ),
    "law gamma": (lambda p: Gradient(gamma=-3.0), "gamma", "-3.0"),
    "t_end zero": (lambda p: simulation(t_end=0.0), "simulation.t_end", "0.0"),
    "dt negative": (lambda p: simulation(dt=-0.01), "simulation.dt", "-0.01"),
    "dt does not divide": (lambda p: simulation(dt=0.3), "simulation.dt", "0.3"),
    "dt longer than the run": (lambda p: simulation(dt=3.0), "simulation.dt", "3"),
    "dt absurd": (lambda p: simulation(dt=1e-14), "simulation.dt", "1e-14"),
    "solver misspelt": (lambda p: simulation(solver="rk5"), "simulation.solver", "did you mean 'rk4'?"),
    "solver of another kind": (lambda p: simulation(solver=4), "simulation.solver", "euler, heun, rk4"),
    "record_points one": (lambda p: simulation(record_points=1), "simulation.record_points", "1"),
    "record_points fractional": (lambda p: simulation(record_points=10.5), "simulation.record_points", "10.5"),
    "a controller that is none": (lambda p: ClosedLoop.of(p, 42), "controller", "42"),
    "a controller's class": (lambda p: ClosedLoop.of(p, Mrac), "controller", "Mrac"),
    "no controllers": (lambda p: simulate(p, [], simulation()), "controller", "none"),
    "simulate a number": (lambda p: simulate(p, [42], simulation()), "controller", "42"),
    "simulate text": (lambda p: simulate(p, "mrac", simulation()), "controller", "mrac"),
    "simulate without settings": (lambda p: simulate(p, [Mrac(gamma=1.0)], None), "simulation", "None"),
    "simulate no problem": (lambda p: simulate(None, [Mrac(gamma=1.0)], simulation()), "problem", "None"),
    "a name that is none": (lambda p: simulate(p, [Mrac(gamma=1.0, name=["a"])], simulation()), "name", "['a']"),
    "threads negative": (lambda p: simulate(p, [Mrac(gamma=1.0)], simulation(), threads=-1), "threads", "-1"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_with_the_field_and_the_value(section_v, case):
    make, field, value = REFUSED[case]
    message = refusal(lambda: make(section_v))
    assert field in message
    assert value in message


def test_a_singular_A_m_is_not_hurwitz_in_any_coordinates():
    """The zero eigenvalue of the matrix is computed as a rounding of either sign. Both must be rejected, because P would be a
    division by it."""
    for angle in np.linspace(0.1, 3.0, 30):
        T = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        refusal(lambda T=T: plant(A_m=T @ np.diag([0.0, -1.0]) @ T.T, b=T @ [1.0, 1.0]))


@pytest.mark.parametrize("n", [2, 3, 4, 5])
@pytest.mark.parametrize("rate", [0.01, 1.0, 100.0, 1e4])
def test_a_companion_pair_is_controllable_at_any_time_scale(n, rate):
    """(companion matrix, e_n) is controllable for any polynomial, because its controllability matrix is triangular with ones on
    the diagonal."""
    polynomial = np.poly(-rate * np.linspace(0.8, 1.2, n))
    A_m = np.diag(np.ones(n - 1), 1)
    A_m[-1] = -polynomial[:0:-1]
    Plant(A_m=A_m, b=np.eye(n)[-1], theta=np.zeros(n))


@pytest.mark.parametrize("n", [2, 3, 4])
def test_an_uncontrollable_pair_is_refused_in_random_coordinates(n):
    """A diagonal pair with one entry of b zero is transformed by an orthogonal matrix. Roundings must not make it
    controllable."""
    random = np.random.default_rng(n)
    for _ in range(20):
        T = np.linalg.qr(random.normal(size=(n, n)))[0]
        b = random.normal(size=n)
        b[random.integers(n)] = 0.0
        A_m = T @ np.diag(-random.uniform(0.5, 5, n)) @ T.T
        assert "controllable" in refusal(lambda A_m=A_m, b=T @ b: Plant(A_m=A_m, b=b, theta=np.zeros(len(b))))


def test_the_step_that_the_message_proposes_is_accepted():
    """The printed step is accepted as input for 500 pairs that a user might give."""
    random = np.random.default_rng(0)
    for _ in range(500):
        t_end, dt = float(f"{random.uniform(0.1, 100):.3g}"), float(f"{10 ** random.uniform(-5, 0):.2g}")
        if abs(t_end / dt - round(t_end / dt)) < 1e-6 or t_end < dt:
            continue
        message = refusal(lambda t_end=t_end, dt=dt: Simulation(t_end=t_end, dt=dt))
        proposed = float(message.split(";")[-1].replace("would", ""))
        assert Simulation(t_end=t_end, dt=proposed).steps == round(t_end / dt)


@pytest.mark.parametrize("tau", [1e-300, 4.4e-212, 1e-160, 1e30, 4.2e37, 1e200])
def test_an_absurd_tau_is_carried_or_refused(section_v, tau):
    """Q = W_m^-1/(tau s + 1)^n* exceeds the range of doubles, without a warning or an infinite matrix."""
    for c_0 in ([1.0, 1.0], [1.0, 0.0]):
        equations = accepted_or_refused_well(RobustMrac(tau=tau, law=LAW, c_0=c_0).bind, {}, "known", section_v.known)
        if equations is not None:
            assert all(np.isfinite(part).all() for part in (equations.Q.A, equations.Q.B, equations.Q.C, equations.Q.D))


def test_numbers_of_numpy_are_numbers():
    """Such numbers are accepted even if their arithmetic would overflow."""
    assert Step(np.int8(100), 0.0, np.int8(100))(np.array([1.0])) == 200
    assert Simulation(t_end=np.float32(1), dt=np.float64(0.5), record_points=np.int64(5)).steps == 2
    chirp = Chirp(1.0, np.uint8(5), np.uint8(1), 4.0)
    assert chirp(np.array([2.0])) == pytest.approx(np.sin(5 * 2 - 2**2 / 2), rel=1e-14)
    assert Mrac(gamma=np.int16(3)).gamma == 3.0


# --- any input gives an InputError of one sentence or an object ---

ODD_OBJECTS = {
    "a huge integer": lambda: 10**400, "int8": lambda: np.int8(3), "float32": lambda: np.float32(0.5),
    "longdouble": lambda: np.longdouble(1),
    "bool_": lambda: np.bool_(True), "object": object, "a class": lambda: Sine, "a signal": lambda: Sine(1.0, 2.0),
    "a scheme": lambda: Mrac,
    "a solver": lambda: RK4, "a law": lambda: LAW, "bytes": lambda: b"1", "a dict": dict, "a set": lambda: {1.0},
    "a range": lambda: range(3),
    "a slice": lambda: slice(2), "empty": lambda: np.zeros((0, 0)), "2 x 2": lambda: np.zeros((2, 2)),
    "cube": lambda: np.zeros((2, 2, 2)),
    "array of None": lambda: np.array(None), "complex": lambda: np.array([1j, 2]), "texts": lambda: np.array(["a", "b"]),
    "array of objects": lambda: np.array([object(), 1]), "list of arrays": lambda: [np.eye(2), np.eye(2)],
    "masked": lambda: np.ma.masked_array([1.0, 2.0], mask=[True, False]), "a date": lambda: np.datetime64("2020-01-01"),
    "large": lambda: np.full((2, 2), 1e308), "large and stable": lambda: [[-1e308, 1e308], [-1e308, -1e308]],
    "denormal": lambda: [1e-320, 1e-320], "SX": lambda: ca.SX.sym("a", 2), "MX": lambda: ca.MX.sym("a", 2),
    "DM": lambda: ca.DM([1, 2]),
    "list with SX": lambda: [ca.SX.sym("a"), 1.0], "beyond a double": lambda: np.full(2, np.longdouble(10) ** 400),
    "digits": lambda: "12",
    "tuples": lambda: ((1, 2), (3, 4)), "an iterator": lambda: iter([1.0, 2.0]), "a generator": lambda: (v for v in [1.0]),
}  # fmt: skip
ODD = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.complex_numbers(),
    st.text(max_size=5),
    st.lists(st.floats(), max_size=4),
    st.lists(st.lists(st.floats(-10, 10), max_size=3), max_size=3),
    st.lists(st.one_of(st.none(), st.floats(), st.text(max_size=2)), max_size=3),
    st.sampled_from(sorted(ODD_OBJECTS)).map(lambda name: ODD_OBJECTS[name]()),
)


def plant_of_A(**given):
    return Plant(**given)


VALID = {
    Plant: {"A_m": A_M, "b": [0.0, 1.0], "theta": [4.0, -3.0], "x0": [1.0, 1.0]},
    plant_of_A: {"A": [[0.0, 1.0], [3.7, -4.0]], "A_m": A_M, "b": [0.0, 1.0], "x0": [1.0, 1.0]},
    ReferenceModel: {"k_0": 4.0},
    ParameterBox: {"lower": [-5.0, -5.0], "upper": [5.0, 5.0]},
    Problem: {
        "plant": plant(),
        "reference_model": ReferenceModel(),
        "reference": Constant(),
        "uncertainty": None,
        "disturbance": None,
    },
    TransferFunction: {"num": [1.0], "den": [1.0, 1.0]},
    input_filter: {"kappa": 0.02},
    Simulation: {"t_end": 1.0, "dt": 0.01, "solver": RK4, "record_points": 10},
    Constant: {"amplitude": 1.0},
    Sine: {"amplitude": 1.0, "frequency": 1.0, "phase": 0.0, "constant": 0.0},
    Sines: {"amplitudes": [1.0], "frequencies": [1.0], "phases": [0.0], "constant": 0.0},
    Chirp: {"amplitude": 1.0, "frequency_start": 1.0, "frequency_end": 2.0, "duration": 1.0, "constant": 0.0},
    Step: {"amplitude": 1.0, "start": 0.0, "constant": 0.0},
    Steps: {"times": [0.0, 1.0], "values": [1.0, 2.0], "initial": 0.0},
    Square: {"amplitude": 1.0, "frequency": 1.0, "phase": 0.0, "constant": 0.0},
    Recorded: {"times": [0.0, 1.0], "values": [1.0, 2.0]},
    Recorded.from_mat: {"file": "nowhere.mat"},
    Recorded.from_csv: {"file": "nowhere.csv"},
    Gradient: {"gamma": 1.0},
    LeastSquares: {"covariance0": 1.0, "leakage": SwitchingSigma(sigma=1.0, M_0=1.0), "dead_zone": DeadZone(g_0=0.1)},
    LeastSquaresForgetting: {"covariance0": 1.0, "forgetting": 0.1},
    LeastSquaresResetting: {"rho_0": 1.0, "rho_1": 0.1, "leakage": FixedSigma(sigma=1.0)},
    LeastSquaresBounded: {"covariance0": 1.0, "forgetting": 0.1, "covariance_bound": 10.0},
    LeastSquaresBoundedGain: {"covariance0": 1.0, "forgetting": 0.1, "covariance_bound": 10.0},
    IntegralCost: {"gamma": 1.0, "forgetting": 0.1, "leakage": FixedSigma(sigma=1.0)},
    FixedSigma: {"sigma": 1.0},
    SwitchingSigma: {"sigma": 1.0, "M_0": 5.0},
    EpsilonModification: {"nu": 1.0},
    DeadZone: {"g_0": 0.1},
    CompositeLearning: {"gamma_c": 1.0, "time_constant": 0.1, "forgetting": 0.0, "capacity": None},
    ParameterBall: {"center": [0.0, 0.0], "radius": 5.0},
    Normalization: {"alpha_0": 1.0, "delta_0": 0.1},
}
SCHEMES = {
    Mrac: {"gamma": 1.0, "theta_hat0": [0.0, 0.0], "projection": True, "leakage": None, "dead_zone": None, "learning": None},
    L1Adaptive: {"gamma": 1.0, "filter": input_filter(0.02), "theta_hat0": [0.0, 0.0], "projection": True},
    NormalizedMrac: {"law": LAW, "c_0": [1.0, 1.0], "normalization": Normalization(), "theta_hat0": None, "projection": None},
    RobustMrac: {"law": LAW, "c_0": [1.0, 1.0], "tau": 0.5, "normalization": Normalization(), "theta_hat0": None},
}
FUZZ = settings(
    max_examples=150,
    derandomize=True,  # the same inputs in every run: a failure is reproducible
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)


def accepted_or_refused_well(make, valid, field, value):
    """Check an input. Warnings are errors, as everywhere in the suite."""
    try:
        made = make(**(valid | {field: value}))
    except InputError as error:
        message = str(error)
        assert message and "\n" not in message and len(message) < 600, message
        return None
    return made


@pytest.mark.parametrize("make", VALID, ids=lambda make: make.__qualname__)
def test_whatever_a_constructor_is_given(make):
    @FUZZ
    @given(field=st.sampled_from(sorted(VALID[make])), value=ODD)
    def fuzz(field, value):
        accepted_or_refused_well(make, VALID[make], field, value)

    fuzz()


@pytest.mark.parametrize("make", SCHEMES, ids=lambda make: make.__qualname__)
def test_whatever_a_scheme_is_given(section_v, make):
    @FUZZ
    @given(field=st.sampled_from(sorted(SCHEMES[make])), value=ODD)
    def fuzz(field, value):
        controller = accepted_or_refused_well(make, SCHEMES[make], field, value)
        if controller is not None:
            accepted_or_refused_well(controller.bind, {}, "known", section_v.known)

    fuzz()


def test_no_warning_comes_before_the_message():
    """A warning on standard error in addition to the sentence would be a second sentence."""
    for make in (lambda: plant(b=[0, 2j]), lambda: input_filter(1e-320)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            refusal(make)
        assert [str(w.message) for w in caught] == []
