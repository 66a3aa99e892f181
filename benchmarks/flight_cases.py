"""Controllers of every scheme, with two states or one output, whose cost on a flight computer is measured."""

from __future__ import annotations

from dataclasses import replace

from barbalat import (
    Adrc,
    BaselineAlone,
    DirectMrac,
    KnownParameters,
    L1Adaptive,
    L1Output,
    L1OutputPiecewiseConstant,
    L1PiecewiseConstant,
    LinearFeedback,
    LinearOutput,
    MitRule,
    Mrac,
    MracClosedLoop,
    MracOutput,
    NetworkMrac,
    NormalizedMrac,
    OutputPlant,
    OutputProblem,
    OutputReferenceModel,
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
from barbalat.laws import FixedSigma, Gradient, LeastSquares, LyapunovLaw
from barbalat.plants import PlantInput, Shell
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.regressors import Terms
from barbalat.signals import Sine

T = 0.01
SIMULATION = Simulation(t_end=2.0, dt=T / 2)
COMMAND = Sine(amplitude=1.0, frequency=0.7)

STATE = Problem(
    plant=Plant(
        A_m=[[0.0, 1.0], [-2.0, -3.0]], b=[0.0, 1.0], theta=[1.0, -0.5], x0=[0.3, -0.2], input=PlantInput(saturation=[-3.0, 3.0])
    ),
    reference_model=ReferenceModel(k_0=2.0),
    reference=COMMAND,
    uncertainty=ParameterBox(lower=[-2.0, -1.0], upper=[2.0, 1.0]),
)
SEVERAL = Problem(
    plant=Plant(A_m=[[-2.0, 0.0], [0.0, -3.0]], b=[[1.0, 0.2], [0.0, 1.0]], theta=[0.5, -0.3, 0.2, 0.4], x0=[0.3, -0.2]),
    reference_model=ReferenceModel(k_0=[[2.0, 0.0], [0.0, 3.0]]),
    reference=(COMMAND, Sine(amplitude=0.5, frequency=1.3)),
    uncertainty=ParameterBox(lower=[-1.0] * 4, upper=[1.0] * 4),
)
TERMS = replace(
    STATE,
    plant=replace(STATE.plant, regressor=Terms(terms=("sin(3*x1)", "exp(-x2**2)")), theta=[0.5, -0.4]),
)
OUTPUT = OutputProblem(
    plant=OutputPlant(transfer_function=TransferFunction([2.0, 6.0], [1.0, 3.0, 1.0])),
    reference_model=OutputReferenceModel(transfer_function=TransferFunction([2.0], [1.0, 2.0])),
    reference=COMMAND,
)
THIRD = replace(
    OUTPUT,
    plant=OutputPlant(transfer_function=TransferFunction([1.0], [1.0, 3.0, 3.0, 1.0])),
    reference_model=OutputReferenceModel(transfer_function=TransferFunction([1.0], [1.0, 3.0, 3.0, 1.0])),
)
FILTER = TransferFunction([400.0], [1.0, 28.0, 400.0])


def _sampled(controller: Controller, discretization: str = "midpoint") -> Sampled:
    return Sampled(controller=controller, sample_time=T, discretization=discretization)


CASES = [
    ("MRAC, Euler", STATE, _sampled(Mrac(gamma=20.0), "euler")),
    ("MRAC", STATE, _sampled(Mrac(gamma=20.0))),
    (
        "MRAC, closed-loop reference model, Euler",
        STATE,
        _sampled(MracClosedLoop(gamma=20.0, model_feedback=[[-1.0, 0.0], [0.0, -1.0]]), "euler"),
    ),
    ("MRAC, direct, Euler", STATE, _sampled(DirectMrac(gamma=5.0), "euler")),
    (
        "MRAC, network of 8 neurons, Euler",
        STATE,
        _sampled(NetworkMrac(gamma=10.0, leakage=FixedSigma(0.1), neurons=8), "euler"),
    ),
    ("MIT rule, Euler", STATE, _sampled(MitRule(gamma=0.5), "euler")),
    ("MRAC, regressor with sin and exp", TERMS, _sampled(Mrac(gamma=20.0))),
    ("L1, filter of first order", STATE, _sampled(L1Adaptive(gamma=1e3, filter=input_filter(0.05)))),
    ("L1, filter of second order", STATE, _sampled(L1Adaptive(gamma=1e3, filter=FILTER))),
    ("L1, two inputs", SEVERAL, _sampled(L1Adaptive(gamma=1e3, filter=input_filter(0.05)))),
    ("L1, piecewise constant", STATE, L1PiecewiseConstant(sample_time=T, filter=FILTER)),
    ("normalised MRAC, gradient", STATE, _sampled(NormalizedMrac(law=Gradient(gamma=2.0)))),
    ("normalised MRAC, least squares", STATE, _sampled(NormalizedMrac(law=LeastSquares(covariance0=10.0)))),
    ("robust MRAC, gradient", STATE, _sampled(RobustMrac(tau=0.3, law=Gradient(gamma=2.0)))),
    ("robust MRAC, least squares", STATE, _sampled(RobustMrac(tau=0.3, law=LeastSquares(covariance0=10.0)))),
    ("robust MRAC, two inputs, gradient, Euler", SEVERAL, _sampled(RobustMrac(tau=0.3, law=Gradient(gamma=2.0)), "euler")),
    ("linear, one state", STATE, _sampled(LinearFeedback(controller=TransferFunction([50.0, 40.0], [1.0, 0.0])))),
    ("ADRC", STATE, _sampled(Adrc(bandwidth=5.0))),
    ("baseline alone", STATE, _sampled(BaselineAlone())),
    ("known parameters, Euler", STATE, _sampled(KnownParameters(theta=[1.0, -0.5]), "euler")),
    (
        "output MRAC, n* = 1, Lyapunov, Euler",
        OUTPUT,
        _sampled(MracOutput(order=1, relative_degree=1, sign=1, law=LyapunovLaw(gamma=2.0)), "euler"),
    ),
    (
        "output MRAC, n* = 1, least squares",
        OUTPUT,
        _sampled(MracOutput(order=1, relative_degree=1, sign=1, law=LeastSquares(covariance0=10.0), c_0_min=0.1, tau=0.3)),
    ),
    (
        "output MRAC, n* = 3, gradient",
        THIRD,
        _sampled(MracOutput(order=3, relative_degree=3, sign=1, law=Gradient(gamma=1.0), c_0_min=0.05, tau=0.3)),
    ),
    (
        "L1, output feedback",
        OUTPUT,
        _sampled(L1Output(m=2.0, gamma=300.0, filter=TransferFunction([30.0], [1.0, 30.0]), sigma_bound=100.0)),
    ),
    (
        "L1, output feedback, piecewise constant",
        OUTPUT,
        L1OutputPiecewiseConstant(sample_time=T, filter=TransferFunction([30.0], [1.0, 30.0])),
    ),
    (
        "linear, output feedback",
        OUTPUT,
        _sampled(LinearOutput(loop=TransferFunction([2.0], [1.0, 0.0]), feedforward=TransferFunction([1.0], [0.1, 1.0]))),
    ),
]
"""The cases. They use midpoint steps unless they say otherwise."""


def shelled(problem: TrackingProblem) -> TrackingProblem:
    """Add a shell that checks every measured channel. It has every part except *stuck*, which is off by default."""
    names = problem.handed_names
    shell = Shell(
        range={name: [-50.0, 50.0] for name in names},
        rate=dict.fromkeys(names, 500.0),
        jitter=0.1,
        longest_outage=0.2,
        fallback="fade",
    )
    return replace(problem, shell=shell)  # type: ignore[type-var]
