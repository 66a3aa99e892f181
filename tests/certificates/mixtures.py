"""Problems with random combinations of disturbances of an adaptive loop, and the controllers that fit them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from barbalat import (
    InputError,
    L1Adaptive,
    LinearFeedback,
    Mrac,
    NormalizedMrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    RobustMrac,
    Sampled,
    Simulation,
    TransferFunction,
    input_filter,
)
from barbalat.adaptation import laws
from barbalat.adaptation.law import Normalization
from barbalat.adaptation.learning import CompositeLearning
from barbalat.adaptation.modifications import DeadZone, EpsilonModification, FixedSigma, SwitchingSigma
from barbalat.controllers import Adrc, DirectMrac, KnownParameters, MitRule, MracClosedLoop, NetworkMrac
from barbalat.controllers.windup import ModifiedError
from barbalat.loop.binding import bound
from barbalat.plants import ParameterBall, PlantInput
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.regressors import GaussianRBF, Polynomial, Terms
from barbalat.problem.tracking import Disturbance, TrackingProblem
from barbalat.protocols import Controller
from barbalat.signals import Constant, Sine, Sines, Square, Step

SIMULATION = Simulation(t_end=24.0, dt=2e-3)
"""About ten time constants of the models. The gains are drawn so that RK4 resolves the laws at this step."""

TF = TransferFunction
LAG = TF([900.0], [1.0, 42.0, 900.0])
AT_THE_INPUT: dict[str, dict[str, object]] = {
    "delay": {"delay": 0.1, "history": 0.3},
    "actuator": {"actuator": LAG},
    "unmodelled": {"multiplicative": TF([-0.05, 0.0], [0.02, 1.0])},
    "saturation": {"saturation": [-1.5, 1.5]},
    "rate limit": {"rate_limit": 3.0},
    "quantiser": {"quantization": 0.4},
    "gain": {"gain": 0.6},
}
ELSEWHERE: dict[str, dict[str, object]] = {
    "disturbance": {"disturbance": Sine(0.8, 1.7, constant=0.5)},
    "lag": {"sensor": Sensor(lag=0.05)},
    "noise": {"sensor": Sensor(noise=Noise(std=0.05, sample_time=0.02, seed=1))},
}
FEATURES = (*AT_THE_INPUT, *ELSEWHERE)


def disturbed(problem: TrackingProblem, features: tuple[str, ...]) -> TrackingProblem:
    """The problem with its additional disturbances."""
    settings: dict[str, object] = {}
    path = problem.plant.paths[0]
    for feature in features:
        if feature in AT_THE_INPUT:
            path = replace(path, **AT_THE_INPUT[feature])
            settings["plant"] = replace(problem.plant, input=path)
        elif feature == "disturbance" and problem.feedback == "state":  # of a plant with any number of inputs
            settings["unmatched"] = (
                Disturbance(direction=np.ones(problem.plant.states), signal=ELSEWHERE[feature]["disturbance"]),
            )
        else:
            sensor: Sensor = ELSEWHERE[feature].get("sensor")
            settings |= ELSEWHERE[feature]
            if sensor is not None and "sensor" in settings and {"lag", "noise"} <= set(features):
                settings["sensor"] = Sensor(lag=0.05, noise=ELSEWHERE["noise"]["sensor"].noise)
    return replace(problem, **settings)


def some_features(random: np.random.Generator) -> tuple[str, ...]:
    """Some features at random. Two problems in five have none, so the guarantees apply. The others have one to three."""
    count = random.choice([0, 0, 1, 2, 3])
    return tuple(random.choice(FEATURES, size=count, replace=False))


def command(random: np.random.Generator) -> object:
    a, w = random.uniform(0.5, 2.0), random.uniform(0.4, 3.0)
    choices: list[Callable[[], object]] = [
        lambda: Constant(a),
        lambda: Step(a, start=1.0),
        lambda: Sine(a, w),
        lambda: Square(a, w),
        lambda: Sines(amplitudes=(a, 0.5), frequencies=(w, 3.1 * w)),
    ]
    return choices[random.integers(len(choices))]()


def state_feedback(random: np.random.Generator) -> Problem:
    """A problem with one to three states. Often theta makes the plant unstable, and one theta in six is outside the known set."""
    n = int(random.integers(1, 4))
    b = np.zeros(n)
    b[-1] = random.choice([1.0, 0.7, -1.0])
    poles = -random.uniform(0.5, 2.5, n)
    A_m = np.eye(n, k=1)
    A_m[-1] = -np.poly(poles)[1:][::-1]
    regressor: dict[str, object] = {}
    if random.random() < 0.25:
        shapes = (
            Polynomial(degree=2),
            GaussianRBF(centers=[[0.0] * n, [1.0] * n], width=1.0),
            Terms(terms=("x1", "x1/(1 + x1**2)")),
        )
        regressor["regressor"] = (*shapes, Terms(terms=("sqrt(x1)",)), Terms(terms=("1/x1",)))[random.integers(5)]
    inputs = 2 if n > 1 and random.random() < 0.15 else 1
    if inputs == 2:
        b = np.column_stack([b, np.eye(n)[0]])
    p = regressor["regressor"].size(n) if regressor else n
    theta = random.uniform(-2.0, 2.0, (p, inputs) if inputs > 1 else p)
    plant = Plant(A_m=A_m, b=b, theta=theta, x0=random.uniform(-1, 1, n) * random.integers(0, 2), **regressor)
    k_0 = random.uniform(0.5, 2.0)
    given = Problem(
        plant=plant,
        reference_model=ReferenceModel(k_0=k_0 if inputs == 1 else [[k_0], [0.5]]),
        reference=command(random) if inputs == 1 else [command(random)],
        uncertainty=None if random.random() < 0.2 else known_set(random, plant.theta),
    )
    if random.random() < 0.15:
        given = replace(given, input_gain=(0.4, 1.6), plant=replace(plant, input=PlantInput(gain=random.uniform(0.5, 1.5))))
    return disturbed(given, some_features(random)) if random.random() < 0.8 else given


def known_set(random: np.random.Generator, theta: np.ndarray) -> ParameterBox | ParameterBall:
    size = np.abs(theta).max() * (random.uniform(0.3, 0.9) if random.random() < 1 / 6 else random.uniform(1.0, 1.5))
    if random.random() < 0.3:
        return ParameterBall(center=np.zeros(len(theta)), radius=size * np.sqrt(len(theta)))
    return ParameterBox(lower=np.full(len(theta), -size), upper=np.full(len(theta), size))


def leakage(random: np.random.Generator) -> object:
    kinds = (
        FixedSigma(sigma=3.0),
        EpsilonModification(nu=3.0),
        SwitchingSigma(sigma=2.0, M_0=0.3),
        SwitchingSigma(sigma=2.0, M_0=9.0),
    )
    return kinds[random.integers(len(kinds))]


def parametric_law(random: np.random.Generator) -> object:
    """A random law of the family, sometimes with a far too large leakage or dead zone."""
    more = (({}, {}, {"leakage": leakage(random)}, {"dead_zone": DeadZone(g_0=5.0)}))[random.integers(4)]
    P = {"covariance0": random.uniform(1, 20)}
    kinds: list[Callable[[], object]] = [
        lambda: laws.Gradient(gamma=random.uniform(1, 20), **more),
        lambda: laws.LeastSquares(**P, **more),
        lambda: laws.LeastSquaresForgetting(**P, forgetting=0.3, **more),
        lambda: laws.LeastSquaresResetting(rho_0=20.0, rho_1=0.1, **more),
        lambda: laws.LeastSquaresBounded(**P, forgetting=0.3, covariance_bound=90.0, **more),
        lambda: laws.LeastSquaresBoundedGain(**P, forgetting=0.3, covariance_bound=90.0, **more),
        lambda: laws.IntegralCost(
            gamma=random.uniform(1, 20), forgetting=0.5, **{k: v for k, v in more.items() if k == "leakage"}
        ),
    ]
    return kinds[random.integers(len(kinds))]()


def normalization(random: np.random.Generator) -> Normalization:
    return Normalization(alpha_0=float(random.choice([0.0, 1.0])), delta_0=0.7)


def state_controllers(random: np.random.Generator, problem: Problem) -> list[Controller]:
    """One of each scheme that fits the problem, and one of them sampled."""
    n, gamma = problem.plant.n, 10 ** random.uniform(0, 2)
    p = problem.known.parameters
    root = random.normal(size=(p, p))
    gain = (gamma, gamma * (root @ root.T / p + 0.1 * np.eye(p)))[random.integers(2)]
    projection = None if random.random() < 0.8 else False
    saturated = problem.known.saturation is not None and random.random() < 0.5
    modified: dict[str, object] = ({}, {}, {"leakage": leakage(random)}, {"dead_zone": DeadZone(g_0=3.0)},
                {"learning": CompositeLearning(gamma_c=1.0, time_constant=0.3, capacity=1.0)})[random.integers(5)]  # fmt: skip
    network_leakage = FixedSigma(0.02) if random.random() < 0.5 else EpsilonModification(nu=0.5)
    made: list[Callable[[], Controller]] = [
        lambda: Mrac(gamma=gain, projection=projection, modified_error=ModifiedError(mu=0.5) if saturated else None, **modified),
        lambda: MracClosedLoop(gamma=gain, model_feedback=-random.uniform(0.2, 2) * np.eye(n), projection=projection),
        lambda: L1Adaptive(
            gamma=gamma, filter=input_filter(10 ** random.uniform(-2, -0.5)), saturated_predictor=saturated, **modified
        ),
        lambda: L1Adaptive(gamma=gain, filter=None, projection=projection, name="C = 1", **modified),
        lambda: NormalizedMrac(law=parametric_law(random), normalization=normalization(random), projection=projection),
        lambda: RobustMrac(
            tau=random.choice([0.2, 2.0]), law=parametric_law(random), normalization=normalization(random), projection=projection
        ),
        lambda: LinearFeedback(controller=TF([20.0, 20.0], [1.0, 0.0]), nominal=np.zeros(n)),
        lambda: KnownParameters(theta=problem.plant.theta),
        lambda: Adrc(bandwidth=10 ** random.uniform(0, 2), nominal=problem.plant.theta if random.random() < 0.5 else None),
        lambda: MitRule(gamma=gain, gamma_r=gamma, normalization=random.choice([None, 1.0]), projection=projection),
        lambda: DirectMrac(gamma=gain, gamma_r=gamma, projection=projection),
        lambda: NetworkMrac(gamma=gain, gamma_v=gamma, neurons=4, leakage=network_leakage),
    ]
    return fitting(random, problem, made)


def fitting(random: np.random.Generator, problem: TrackingProblem, made: list[Callable[[], Controller]]) -> list[Controller]:
    """The controllers that fit this kind of problem. One in three is sampled."""
    found: list[Controller] = []
    for make in made:
        sampled, form = random.random() < 1 / 3, str(random.choice(["midpoint", "euler"]))
        try:
            controller = make()
            if sampled:
                controller = Sampled(controller=controller, sample_time=0.02, discretization=form)
            bound(problem, controller)
        except InputError:
            continue
        found.append(controller)
    return found
