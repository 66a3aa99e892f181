"""Margins of sampled adaptive loops, linearised in sampled-data form at their equilibrium, compared with runs of the nonlinear
loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from barbalat import (
    DirectMrac,
    KnownParameters,
    L1Adaptive,
    Mrac,
    MracClosedLoop,
    NormalizedMrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Sampled,
    Simulation,
    certify,
    input_filter,
)
from barbalat.certificates.linear_loops.sampled_rest import adapting_of, sampled_rest
from barbalat.laws import Gradient
from barbalat.plants import PlantInput
from barbalat.signals import Constant, Sine

T, DT = 0.05, 1e-3
PLANT = Plant(A_m=[[0.0, 1.0], [-2.0, -2.0]], b=[0.0, 1.0], theta=[0.6, -0.4], x0=[2.0, 0.0])
PROBLEM = Problem(  # at equilibrium under its command from the start
    plant=PLANT,
    reference_model=ReferenceModel(k_0=2.0),
    reference=Constant(2.0),
    uncertainty=ParameterBox(lower=[-3, -3], upper=[3, 3]),
)
SCHEMES = {
    "mrac": Mrac(gamma=2.0),
    "l1": L1Adaptive(gamma=5.0, filter=input_filter(0.1)),
    "normalised": NormalizedMrac(law=Gradient(gamma=5.0)),
    "direct": DirectMrac(gamma=1.0),
    "closed-loop model": MracClosedLoop(gamma=1.0, model_feedback=[[-1.0, 0.0], [0.0, -1.0]]),
}
EULER_ONLY = ("direct", "closed-loop model")
CASES = [(name, form) for name in SCHEMES for form in ("euler", "midpoint") if form == "euler" or name not in EULER_ONLY]


def sampled(name, form, sample_time=T):
    return Sampled(controller=SCHEMES[name], sample_time=sample_time, discretization=form)


def certified(controller, problem=PROBLEM, keys=("delay_margin", "delay_margin_adapting")):
    """The certificate; the searches over the known set and for the longest sample time are left out unless the keys name them."""
    T = controller.sample_time
    return certify(problem, [controller], Simulation(t_end=100 * T, dt=T / 10), keys=keys)[controller.name]


SUBSTEPS = 10
"""Parts of a sample. Within a part the delayed input of the plant is constant."""


def dies_out(controller, delay=0.0):
    """Whether a disturbance of the estimates of 1e-6 decays in all other states. The controller's own equations act at the
    samples, and the linear plant moves between them by its transition matrix.

    The loop starts at its equilibrium, which a case file can't express if a filter starts at zero.
    """
    rest = sampled_rest(PROBLEM, controller, adapting_of(PROBLEM, controller.controller), frozen=False)
    loop, state, signals = rest.loop, rest.state.copy(), rest.signals
    places = loop.unpack(np.arange(loop.size))
    (part,) = [one for one in loop.parts if one.name == "theta_hat"]
    k_r = [row for one in loop.parts if one.name == "k_r_hat" for row in range(loop.size)[one.rows]]
    state[part.rows] += 1e-6 * np.array([1.0, -0.5])
    others = np.setdiff1d(np.arange(loop.size), [*range(loop.size)[part.rows], *places.held.theta_hat, *k_r])
    h = controller.sample_time / SUBSTEPS
    late = [float(state[places.held.u])] * round(delay / h)  # delayed input of the plant
    held = expm(h * np.block([[PLANT.A, PLANT.b[:, None]], [np.zeros((1, 3))]]))  # rates of x and of v, which is constant

    seen = []
    for _ in range(int(max(500, 100 / controller.sample_time))):
        state = np.asarray(loop.sample(state, signals), dtype=float)
        for _ in range(SUBSTEPS):
            late.append(float(state[places.held.u]))
            state[places.x] = held[:2] @ [*state[places.x], late.pop(0)]
        seen.append(np.abs((state - rest.state)[others]).max())
        if not seen[-1] < 1e-2:
            return False
    fourth = len(seen) // 4
    return max(seen[-fourth:]) < max(1e-12, *seen[fourth : 2 * fourth])  # 1e-12: rounding


@pytest.mark.parametrize(("name", "form"), CASES)
@pytest.mark.short(kept=lambda name, form: (name, form) in (("mrac", "midpoint"), ("direct", "euler")))
def test_the_longest_sample_time_is_where_disturbances_stop_dying_out(name, form):
    found = certified(sampled(name, form), keys=["sample_time_max"]).values
    longest = found.get("sample_time_max")
    assert (found["spectral_radius_adapting"] < 1) == (longest is None or longest > T)
    if longest is not None:
        assert dies_out(sampled(name, form, 0.95 * longest)) and not dies_out(sampled(name, form, 1.05 * longest))
    else:
        assert dies_out(sampled(name, form, 100 * T))


@pytest.mark.parametrize(("name", "form"), CASES)
@pytest.mark.short(kept=lambda name, form: (name, form) in (("mrac", "euler"), ("l1", "midpoint")))
def test_the_delay_margin_with_the_law_is_where_disturbances_stop_dying_out(name, form):
    controller = sampled(name, form)
    entry = certified(controller).entry("delay_margin_adapting")
    if entry.applies:
        assert dies_out(controller, 0.95 * entry.value) and not dies_out(controller, 1.05 * entry.value)
    else:
        assert "500 samples" in entry.why and dies_out(controller, 100 * T)


def test_frozen_estimates_make_the_loop_of_known_parameters():
    """All schemes without a filter have the same linear loop, which is written by hand here. A sampled controller that knows
    theta has the same loop."""
    found = {name: certified(sampled(name, "euler")).values for name in ("mrac", "normalised", "direct", "closed-loop model")}
    known = certified(Sampled(controller=KnownParameters(theta=PLANT.theta), sample_time=T, discretization="euler")).values

    A, b, theta = PLANT.A, PLANT.b, PLANT.theta
    whole = expm(T * np.block([[A, b[:, None]], [np.zeros((1, 3))]]))
    radius = np.abs(np.linalg.eigvals(whole[:2, :2] - np.outer(whole[:2, 2], theta))).max()
    assert [one["spectral_radius"] for one in (*found.values(), known)] == pytest.approx([radius] * 5, rel=1e-9)
    margins = [one["delay_margin"] for one in (*found.values(), known)]
    assert margins == pytest.approx([margins[-1]] * 5, rel=1e-6) if margins[-1] is not None else set(margins) == {None}


MARGIN = ("delay_margin_adapting",)


@pytest.mark.parametrize("form", ["euler", "midpoint"])
def test_no_number_of_the_continuous_loop_stands_for_the_sampled_one(form):
    """Each margin belongs to the sampled-data loop. With a short sample it equals the margin of the continuous loop; with a long
    sample it differs."""
    continuous = certify(PROBLEM, [SCHEMES["mrac"]], Simulation(t_end=1.0, dt=DT), keys=MARGIN)["MRAC"].values[MARGIN[0]]
    short, long = (
        certified(sampled("mrac", form, sample_time), keys=keys) for sample_time, keys in ((2e-3, MARGIN), (0.1, None))
    )
    assert short.values["delay_margin_adapting"] == pytest.approx(continuous, rel=1e-2)
    assert abs(long.values["delay_margin_adapting"] - continuous) > 0.02 * continuous
    for entry in long.entries:
        assert entry.kind != "exact" or "sampled-data" in entry.of
        assert "continuous" not in entry.meaning


def test_an_estimate_on_a_face_has_no_linearisation():
    edge = replace(PROBLEM, uncertainty=ParameterBox(lower=[-3, -3], upper=[0.6, 3]))
    controller = Sampled(controller=Mrac(gamma=2.0), sample_time=T)
    entry = certified(controller, edge).entry("delay_margin_adapting")
    assert not entry.applies and "boundary" in entry.why


def test_the_known_set_is_searched_with_the_estimates_of_each_theta():
    """The frozen loop at a different theta equals the loop in the certificate of the case with that theta."""
    found = certified(sampled("mrac", "euler"), keys=["margins_over_known_set"]).values["margins_over_known_set"]
    (loop,) = found
    where = loop["delay_margin"]
    moved = replace(PROBLEM, plant=replace(PLANT, theta=where["theta"]))
    assert certified(Sampled(controller=Mrac(gamma=2.0), sample_time=T, discretization="euler"), moved).values[
        "delay_margin"
    ] == pytest.approx(where["value"], rel=1e-6)


def test_a_plant_with_a_regressor_a_delay_and_a_lag_rests_too():
    from barbalat.plants import Sensor
    from barbalat.regressors import Terms

    problem = Problem(
        plant=replace(PLANT, theta=[0.3, -0.2, 0.1], regressor=Terms(("x1", "x2", "x1**3")), input=PlantInput(delay=0.01)),
        reference_model=ReferenceModel(k_0=2.0),
        reference=Sine(amplitude=1.0, frequency=1.0),
        sensor=Sensor(lag=0.01),
    )
    controller = Sampled(controller=Mrac(gamma=1.0), sample_time=T)
    found = certified(controller, problem).values
    assert found["spectral_radius"] < 1 and found["spectral_radius_adapting"] < 1 and found["delay_margin_adapting"] > 0


@pytest.mark.parametrize(("theta", "stable"), [((4.0, -3.0), False), ((0.2, 0.1), True)])
@pytest.mark.parametrize("discretization", ["euler", None])
def test_states_that_are_not_fed_back_count_for_stability(theta, stable, discretization):
    """With parameters of zero u does not depend on x, so the plant's own poles are those of the loop."""
    A_m, b = np.array([[0.0, 1.0], [-0.3, -1.0]]), np.array([0.0, 1.0])
    plant = Plant(A_m=A_m, b=b, theta=theta)
    problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=0.3), reference=Constant(1.0))
    law, T = KnownParameters(theta=[0.0, 0.0]), 0.05
    own = law if discretization is None else Sampled(controller=law, sample_time=T, discretization=discretization)
    (found,) = certify(problem, [own], Simulation(t_end=5.0, dt=1e-3), keys=["spectral_radius", "delay_margin"]).values()
    largest = np.linalg.eigvals(A_m + np.outer(b, theta)).real.max()
    assert (largest < 0) == stable == ("delay_margin" in found.values and found.entry("delay_margin").applies)
    if discretization is not None:
        assert found.values["spectral_radius"] == pytest.approx(np.exp(largest * T), rel=1e-9)
