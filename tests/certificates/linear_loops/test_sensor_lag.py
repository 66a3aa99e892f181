"""Margins of loops with a sensor lag, compared with the characteristic equation on the imaginary axis and with runs."""

from dataclasses import replace

import numpy as np
import pytest

from barbalat import (
    KnownParameters,
    L1Adaptive,
    Mrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Simulation,
    certify,
    input_filter,
    simulate,
)
from barbalat.plants import PlantInput, Sensor
from barbalat.signals import Constant

SIMULATION = Simulation(t_end=60.0, dt=1e-3)
KAPPA = 0.05


def problem(theta, lag, size=10.0):
    return Problem(
        plant=Plant(A_m=[[0.0, 1.0], [-1.0, -1.4]], b=[0.0, 1.0], theta=theta, x0=[0.1, 0.0]),
        reference_model=ReferenceModel(k_0=1.0),
        reference=Constant(1.0),
        uncertainty=ParameterBox(lower=[-size, -size], upper=[size, size]),
        sensor=Sensor(lag=lag),
    )


def delay_by_hand(theta, lag, filtered):
    """The delay margin of theta'W_b F around the plant, or of (1 + theta'W) F C/(1 - C) in the limit of fast adaptation, on a
    fine grid."""
    w = np.linspace(1e-2, 60.0, 1_000_001)
    s = 1j * w
    numerator = theta[0] + theta[1] * s
    plant = numerator / (s**2 + (1.4 - theta[1]) * s + 1 - theta[0])
    loop = (1 + plant) / (KAPPA * s) / (lag * s + 1) if filtered else plant / (lag * s + 1)
    crossings = np.flatnonzero(np.diff(np.sign(np.abs(loop) - 1)))
    return min(float((np.angle(loop[i]) + np.pi) % (2 * np.pi) / w[i]) for i in crossings)


@pytest.mark.parametrize(
    ("controller", "filtered"),
    [
        (KnownParameters(theta=[2.0, 1.0]), False),
        (Mrac(gamma=1.0), False),
        (L1Adaptive(gamma=1e4, filter=input_filter(KAPPA)), True),
    ],
    ids=["known", "mrac", "l1"],
)
@pytest.mark.parametrize("lag", [0.1, 0.2])
def test_the_lag_is_in_the_loop(controller, filtered, lag):
    given = problem([2.0, 1.0], lag)
    (found,) = certify(given, [controller], SIMULATION).values()
    margin = found.values.get("delay_margin")
    if margin is None:
        assert any("margins need a stable closed loop" in note for note in found.findings)
    else:
        assert margin == pytest.approx(delay_by_hand([2.0, 1.0], lag, filtered), rel=1e-4)
        assert "with its sensor's lag" in found.entry("delay_margin").of


def test_the_least_margin_of_the_known_set_has_the_lag_too():
    given = problem([0.5, -0.3], 0.3, size=1.5)
    (found,) = certify(given, [Mrac(gamma=1.0)], SIMULATION).values()
    ((loop,),) = [found.values["margins_over_known_set"]]
    at = loop["delay_margin"]
    assert at["value"] == pytest.approx(delay_by_hand(at["theta"], 0.3, filtered=False), rel=1e-3)


@pytest.mark.parametrize(("share", "grows"), [(0.96, False), (1.04, True)])
def test_runs_agree(share, grows):
    given, controller = problem([2.0, 1.0], 0.1), KnownParameters(theta=[2.0, 1.0])
    (found,) = certify(given, [controller], SIMULATION).values()
    delay = round(share * found.values["delay_margin"], 3)
    delayed = replace(given, plant=replace(given.plant, input=PlantInput(delay=delay)))
    (run,) = simulate(delayed, [controller], Simulation(t_end=200.0, dt=1e-3)).values()
    e = np.abs(run.e).max(axis=1)
    quarter = len(e) // 4
    assert (e[3 * quarter :].max() > e[2 * quarter : 3 * quarter].max()) == grows


def test_a_loop_that_the_lag_makes_unstable_has_no_margin():
    for controller in (KnownParameters(theta=[8.0, 4.0]), Mrac(gamma=1.0)):
        (found,) = certify(problem([8.0, 4.0], 0.5), [controller], SIMULATION).values()
        assert "delay_margin" not in found.values
