"""The mixtures with output feedback."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from mixtures import TF, command, disturbed, fitting, leakage, normalization, parametric_law, some_features

from barbalat.adaptation.lyapunov import LyapunovLaw
from barbalat.adaptation.modifications import DeadZone
from barbalat.controllers.output import L1Output, L1OutputPiecewiseConstant, LinearOutput, MracOutput
from barbalat.controllers.output.l1 import linear_equivalent
from barbalat.problem.output_feedback import OutputPlant, OutputProblem, OutputReferenceModel
from barbalat.protocols import Controller
from barbalat.signals import Constant, Sine


def output_feedback(random: np.random.Generator) -> OutputProblem:
    """A plant of first or second order, often unstable and sometimes with f(t, y), with a model of first order."""
    a = random.uniform(-1.0, 2.0)
    plants = (TF([random.uniform(0.5, 2)], [1.0, a]), TF([1.0, 2.0], [1.0, 3.0 + a, 2.0 * a]), TF([50.0], [1.0, 25.0, 50.0]))
    drawn = random.integers(6)
    given = OutputProblem(
        plant=OutputPlant(
            transfer_function=plants[random.integers(3)], nonlinear="0.3*sin(y)*cos(t)" if random.random() < 0.15 else None
        ),
        reference_model=OutputReferenceModel(transfer_function=TF([2.0], [1.0, 2.0])),
        reference=command(random),
        disturbance=(None, Constant(0.4), None)[random.integers(3)],
        output_disturbance=Sine(0.5, 2.0) if drawn == 0 else None,
    )
    return disturbed(given, some_features(random)) if random.random() < 0.8 else given


def output_controllers(random: np.random.Generator, problem: OutputProblem) -> list[Controller]:
    order = int(random.integers(1, 3))
    designed: dict[str, object] = {"order": order, "relative_degree": 1, "sign": 1}
    gamma, zone = random.uniform(1, 10), {"dead_zone": DeadZone(g_0=0.5)}
    modified: dict[str, object] = ({}, {"leakage": leakage(random)}, zone)[random.integers(3)]
    l1 = L1Output(m=2.0, gamma=300.0, filter=TF([20.0], [1.0, 20.0]), sigma_bound=float(random.choice([0.5, 30.0])))
    same = linear_equivalent(l1)
    made: list[Callable[[], Controller]] = [
        lambda: MracOutput(law=LyapunovLaw(gamma=gamma, **modified), **designed),
        lambda: MracOutput(
            law=parametric_law(random), c_0_min=0.05, normalization=normalization(random), name="normalised", **designed
        ),
        lambda: MracOutput(
            law=parametric_law(random),
            c_0_min=0.05,
            tau=2.0,
            normalization=normalization(random),
            lower=np.append(np.full(2 * order - 1, -9.0), 0.05),
            upper=np.full(2 * order, 9.0),
            name="auxiliary",
            **designed,
        ),
        lambda: l1,
        lambda: LinearOutput(loop=same.feedback, feedforward=same.feedforward),
        lambda: LinearOutput(loop=TF([8.0, 8.0], [1.0, 0.0]), name="PI"),
        lambda: L1OutputPiecewiseConstant(sample_time=0.02, filter=TF([20.0], [1.0, 20.0])),
    ]
    return fitting(random, problem, made)
