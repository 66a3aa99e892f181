"""Every scheme, law and modification of the registries as a sampled controller, on problems with noise, limits and delay."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np

from adaptation.examples import laws
from barbalat import (
    OutputPlant,
    OutputProblem,
    OutputReferenceModel,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Sampled,
    Simulation,
    TransferFunction,
    input_filter,
)
from barbalat.controllers import L1Adaptive, L1PiecewiseConstant, Mrac, NormalizedMrac, RobustMrac
from barbalat.controllers.output import L1OutputPiecewiseConstant, LinearOutput, MracOutput
from barbalat.controllers.piecewise_predictor import AsFlown
from barbalat.controllers.windup import ModifiedError
from barbalat.laws import (
    CompositeLearning,
    DeadZone,
    EpsilonModification,
    FixedSigma,
    Gradient,
    LeastSquares,
    LyapunovLaw,
    SwitchingSigma,
)
from barbalat.plants import Noise, ParameterBall, PlantInput, Sensor
from barbalat.regressors import Polynomial, Terms
from barbalat.signals import Sine
from barbalat.validate import InputError
from independent import example_controllers, example_output_controllers

T = 0.01
SIMULATION = Simulation(t_end=100.0, dt=T / 2)
LONG = Simulation(t_end=1000.0, dt=T / 2)
SENSOR = Sensor(lag=0.02, noise=Noise(std=0.01, sample_time=T, bound=0.015, seed=4))
INPUT = PlantInput(saturation=[-3.0, 3.0], rate_limit=200.0, delay=0.007)

STATE = Problem(
    plant=Plant(A_m=[[0.0, 1.0], [-2.0, -3.0]], b=[0.0, 1.0], theta=[1.0, -0.5], x0=[0.3, -0.2], input=INPUT),
    reference_model=ReferenceModel(k_0=2.0),
    reference=Sine(amplitude=1.0, frequency=0.7),
    uncertainty=ParameterBox(lower=[-2.0, -1.0], upper=[2.0, 1.0]),
    sensor=SENSOR,
    name="state",
)
BALL = replace(STATE, uncertainty=ParameterBall(center=[0.0, 0.0], radius=1.2), name="ball")
FREE = replace(STATE, uncertainty=None, name="free")
GAIN = replace(STATE, input_gain=(0.5, 2.0), name="gain")
OUTPUT = OutputProblem(
    plant=OutputPlant(transfer_function=TransferFunction([2.0, 6.0], [1.0, 3.0, 1.0]), input=PlantInput(delay=0.007)),
    reference_model=OutputReferenceModel(transfer_function=TransferFunction([2.0], [1.0, 2.0])),
    reference=Sine(amplitude=1.0, frequency=0.7),
    sensor=SENSOR,
    name="output",
)
THIRD = replace(
    OUTPUT,
    plant=OutputPlant(transfer_function=TransferFunction([1.0], [1.0, 3.0, 3.0, 1.0]), input=INPUT),
    reference_model=OutputReferenceModel(transfer_function=TransferFunction([1.0], [1.0, 3.0, 3.0, 1.0])),
    name="third */ order",
)
POLYNOMIAL = Problem(
    plant=replace(STATE.plant, regressor=Polynomial(degree=2, constant=True), theta=[0.1, 0.5, -0.3, 0.2, 0.1, -0.1]),
    reference_model=ReferenceModel(k_0=2.0),
    reference=Sine(amplitude=1.0, frequency=0.7),
    uncertainty=ParameterBox(lower=[-2.0] * 6, upper=[2.0] * 6),
    sensor=SENSOR,
    name="polynomial",
)
TERMS = replace(
    STATE,
    plant=replace(STATE.plant, regressor=Terms(terms=["sin(3*x1)", "exp(-x2**2)"]), theta=[0.5, -0.4]),
    name="terms",
)
SEVERAL = Problem(
    plant=Plant(
        A_m=[[-2.0, 0.0], [0.0, -3.0]], b=[[1.0, 0.2], [0.0, 1.0]], theta=[0.5, -0.3, 0.2, 0.4], x0=[0.3, -0.2], input=INPUT
    ),
    reference_model=ReferenceModel(k_0=[[2.0, 0.0], [0.0, 3.0]]),
    reference=(Sine(amplitude=1.0, frequency=0.7), Sine(amplitude=0.5, frequency=1.3)),
    uncertainty=ParameterBox(lower=[-1.0] * 4, upper=[1.0] * 4),
    name="several",
)

L1_FILTER = TransferFunction([400.0], [1.0, 28.0, 400.0])


def _lyapunov():
    """MRAC and L1-AC with every option of their law."""
    leakages = (FixedSigma(sigma=0.1), SwitchingSigma(sigma=0.1, M_0=1.2), EpsilonModification(nu=0.2))
    learning = CompositeLearning(gamma_c=2.0, time_constant=0.3, forgetting=0.1, capacity=2.0)
    for law in ({}, *({"leakage": leakage} for leakage in leakages), {"learning": learning}, {"dead_zone": DeadZone(g_0=0.01)}):
        for gamma in (5.0, [5.0, 8.0], [[5.0, 1.0], [1.0, 8.0]]):
            yield STATE, Mrac(gamma=gamma, **law)
            yield FREE, L1Adaptive(gamma=gamma, filter=input_filter(0.05), **law)
    for problem in (STATE, BALL, FREE, GAIN):
        yield problem, Mrac(gamma=20.0)
        yield problem, L1Adaptive(gamma=100.0, filter=L1_FILTER, saturated_predictor=problem is not FREE)
    yield STATE, Mrac(gamma=20.0, modified_error=ModifiedError(mu=0.5, margin=0.1))
    for problem in (POLYNOMIAL, TERMS, SEVERAL):
        yield problem, Mrac(gamma=20.0)
        yield problem, L1Adaptive(gamma=1e4, filter=input_filter(0.05))


def _examples():
    yield from _lyapunov()
    for n_controllers in example_controllers(2).values():
        yield from ((STATE, controller) for controller in n_controllers)
    for scheme, n_controllers in example_output_controllers(1).items():
        # the second linear one is the equivalent of an L1-AC with a high gain, which is unstable at these sample times
        yield from ((OUTPUT, controller) for controller in n_controllers[: 1 if scheme == "linear" else None])
    yield OUTPUT, LinearOutput(loop=TransferFunction([2.0], [1.0, 0.0]), feedforward=TransferFunction([1.0], [0.1, 1.0]))
    for law in (modified.law for modified in laws(2)):
        for problem in (STATE, BALL):
            yield problem, NormalizedMrac(law=law)
        yield FREE, RobustMrac(tau=0.3, law=law, saturated_predictor=False)
        yield OUTPUT, MracOutput(order=1, relative_degree=1, sign=1, law=law, c_0_min=0.1, tau=0.3)
    for law in (Gradient(gamma=1.0), LeastSquares(covariance0=10.0)):
        yield THIRD, MracOutput(order=3, relative_degree=3, sign=1, law=law, c_0_min=0.05, tau=0.3)
    for law in (LyapunovLaw(gamma=2.0), LyapunovLaw(gamma=2.0, leakage=FixedSigma(sigma=0.1))):
        yield OUTPUT, MracOutput(order=1, relative_degree=1, sign=1, law=law)
    for law in (Gradient(gamma=1.0), LeastSquares(covariance0=10.0)):
        yield SEVERAL, RobustMrac(tau=0.3, law=law)
        yield SEVERAL, NormalizedMrac(law=law)


@cache
def sampled_examples() -> list[tuple[str, object, Sampled | L1PiecewiseConstant | L1OutputPiecewiseConstant]]:
    """(id, problem, controller) for every accepted combination. The names are converted to C identifiers."""
    found = []
    for number, (problem, controller) in enumerate(_examples()):
        for discretization in ("midpoint", "euler"):
            sampled = Sampled(controller=replace(controller, name=f"c{number}"), sample_time=T, discretization=discretization)
            try:
                sampled.bind(problem.known)
            except (
                InputError
            ):  # examples that have no midpoint form, do not fit the set or are always sampled are tested where they are rejected
                continue
            found.append((f"{type(controller).__name__}-{problem.name}-{discretization}-{number}", problem, sampled))
    return found + [(f"{type(law).__name__}-{problem.name}-{i}", problem, law) for i, (problem, law) in enumerate(_by_nature())]


def _by_nature() -> Iterator[tuple[Problem | OutputProblem, L1PiecewiseConstant | L1OutputPiecewiseConstant]]:
    """Controllers that are always sampled: both forms, one and several inputs, with compensation, with a saturated predictor."""
    flown = AsFlown(predictor_poles=-5.0, nominal=[0.5, -0.1])
    made = {"sample_time": T, "filter": L1_FILTER}
    yield STATE, L1PiecewiseConstant(**made, name="p0")
    yield STATE, L1PiecewiseConstant(**made, as_flown=flown, saturated_predictor=True, name="p1")
    yield FREE, L1PiecewiseConstant(**made, output=[1.0, 0.0], name="p2")
    yield SEVERAL, L1PiecewiseConstant(sample_time=T, filter=input_filter(0.05), as_flown=AsFlown(), name="p3")
    yield POLYNOMIAL, L1PiecewiseConstant(sample_time=T, filter=None, name="p4")
    yield OUTPUT, L1OutputPiecewiseConstant(sample_time=T, filter=input_filter(0.05), name="p5")


def schemes_covered() -> set[type]:
    return {type(law.controller if isinstance(law, Sampled) else law) for _, _, law in sampled_examples()}


def noise(random: np.random.Generator, values: np.ndarray) -> np.ndarray:
    return values + 0.01 * random.normal(size=values.shape)
