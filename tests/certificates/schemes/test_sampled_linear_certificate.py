"""Sampled linear controllers: their loops and margins, compared with maps written by hand and with runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from barbalat import (
    Adrc,
    BaselineAlone,
    LinearFeedback,
    LinearOutput,
    Mrac,
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
    certify,
    simulate,
)
from barbalat.certificates.certificates import table_1
from barbalat.certificates.linear_loops.from_sample_to_sample import linearised
from barbalat.certificates.summary import five
from barbalat.controllers.output.l1 import L1Output
from barbalat.controllers.output.l1_piecewise import L1OutputPiecewiseConstant
from barbalat.plants import Parameter, PhysicalPlant, PlantInput
from barbalat.signals import Sine

A_M, B, THETA, OMEGA, T = np.array([[0.0, 1.0], [-2.0, -2.0]]), np.array([0.0, 1.0]), np.array([0.6, -0.4]), 40.0, 0.05
SIMULATION = Simulation(t_end=20.0, dt=1e-3)
BOX = ParameterBox(lower=[-1, -1], upper=[1, 1])
PROBLEM = Problem(
    plant=Plant(A_m=A_M, b=B, theta=THETA, x0=[0.1, 0.0]),
    reference_model=ReferenceModel(k_0=2.0),
    reference=Sine(amplitude=1.0, frequency=1.0),
    uncertainty=BOX,
)


def certified(controller, problem=PROBLEM):
    return certify(problem, [controller], SIMULATION)[controller.name]


def moved(t):
    """e^(A t), and the effect over t of an input that is held, for the plant with theta."""
    whole = expm(t * np.block([[A_M + np.outer(B, THETA), B[:, None]], [np.zeros((1, 3))]]))
    return whole[:2, :2], whole[:2, 2]


def radius(discretization, delay, factor=1.0):
    """The loop's spectral radius by hand, with theta_0 = 0, f_hat = xi + omega b'x, xi' = -omega (b'A_m x + u + f_hat) and u =
    -f_hat.

    Euler's rule uses the previous x, the trapezoidal rule the mean of the previous and the present x. The state is x, xi, u and
    the previous u.
    """
    row, b = -OMEGA * B @ A_M, OMEGA * B
    whole, part = divmod(delay / T, 1.0)
    assert whole == 0
    (all_of_it, _), (after, late), (_, early) = moved(T), moved((1 - part) * T), moved(part * T)
    states = np.eye(5)  # x, xi, u of this sample, u of the previous sample
    x, xi, u, before = states[:2], states[2], states[3], states[4]
    x_next = all_of_it @ x + factor * (np.outer(late, u) + np.outer(after @ early, before))
    f_hat = -u
    if discretization == "euler":
        xi_next = xi + T * (row @ x - OMEGA * (u + f_hat))
    else:  # xi' = -omega xi + (row - omega b) x - omega u by the trapezoidal rule, with u held
        forcing = (row - OMEGA * b) @ (x + x_next) / 2 - OMEGA * u
        xi_next = ((1 - OMEGA * T / 2) * xi + T * forcing) / (1 + OMEGA * T / 2)
    u_next = -(xi_next + b @ x_next)
    return float(np.abs(np.linalg.eigvals(np.vstack([x_next, xi_next, u_next, u]))).max())


@pytest.mark.parametrize("discretization", ["euler", "midpoint"])
def test_margins_of_adrc_are_those_of_the_map_by_hand(discretization):
    """The map is stable just inside each margin and unstable just outside. The margins of the continuous loop are different."""
    found = certified(Sampled(Adrc(bandwidth=OMEGA), T, discretization=discretization))
    values = found.values
    assert found.entry("delay_margin").kind == found.entry("gain_margin").kind == "exact"
    assert values["spectral_radius"] == pytest.approx(radius(discretization, 0.0), abs=1e-9)  # rounding of eigenvalues near 1
    assert np.isclose(values["gain_reduction_margin"], 0.0)
    delays = np.append(np.linspace(0, 0.999, 100) * min(values["delay_margin"], T), 0.0)
    assert max(radius(discretization, delay) for delay in delays) < 1
    if values["delay_margin"] < T:
        assert radius(discretization, 1.001 * values["delay_margin"]) > 1
    factors = np.linspace(1.0, 0.999 * values["gain_margin"], 100)
    assert max(radius(discretization, 0.0, factor) for factor in factors) < 1
    assert radius(discretization, 0.0, 1.001 * values["gain_margin"]) > 1
    continuous = certified(Adrc(bandwidth=OMEGA)).values
    assert continuous.get("gain_margin") is None  # the continuous loop has no such margin, the sampled loop has one
    if discretization == "euler":
        assert 0.026 < values["delay_margin"] < 0.028 < continuous["delay_margin"]
        assert 1.05 < values["gain_margin"] < 1.1


def test_the_longest_sample_is_the_loop_s_own():
    """The observer by Euler's method is stable with samples of 0.052 s but not with samples of 0.054 s, so 0.05 s is not called
    too long."""
    found = {sample: certified(Sampled(Adrc(bandwidth=OMEGA), sample, discretization="euler")) for sample in (0.05, 0.052, 0.054)}
    assert [one.values["spectral_radius"] < 1 for one in found.values()] == [True, True, False]
    said = " ".join(found[0.05].findings)
    assert "unstable" not in said
    assert "step_max" not in found[0.05].values
    assert "the sampled-data loop is unstable" in " ".join(found[0.054].findings)
    assert "delay_margin" not in found[0.054].values


def test_over_the_known_set_it_is_the_sampled_loop_too():
    """The smallest margin found belongs to a point of the set and equals the margin there."""
    controller = Sampled(Adrc(bandwidth=OMEGA), T, discretization="euler")
    (loop,) = certified(controller).values["margins_over_known_set"]
    assert loop["delay_margin"]["value"] <= certified(controller).values["delay_margin"]
    for key in ("delay_margin", "gain_margin"):
        theta = np.array(loop[key]["theta"])
        there = certified(controller, replace(PROBLEM, plant=replace(PROBLEM.plant, theta=theta)))
        assert loop[key]["value"] == pytest.approx(there.values[key], rel=1e-9)  # the same matrices are computed in two ways
    wide = replace(PROBLEM, uncertainty=ParameterBox(lower=[-1, -1], upper=[100, 1]))
    assert "unstable_at" in certified(controller, wide).values["margins_over_known_set"][0]


def test_over_the_known_set_an_uncertain_gain_varies_too():
    """The smallest margin is at an end of the gain's interval and equals that plant's margin. A gain with an unstable loop is
    found."""
    gained = replace(PROBLEM, input_gain=(0.5, 1.5))
    controller = Sampled(BaselineAlone(nominal=[4.0, 2.0]), T)
    (loop,) = certified(controller, gained).values["margins_over_known_set"]
    assert loop["delay_margin"]["input_gain"] == 1.5
    for key in ("delay_margin", "gain_margin", "gain_reduction_margin"):
        plant = replace(gained.plant, theta=np.array(loop[key]["theta"]), input=PlantInput(gain=loop[key]["input_gain"]))
        assert loop[key]["value"] == pytest.approx(certified(controller, replace(gained, plant=plant)).values[key], rel=1e-9)
    (fixed,) = certified(controller).values["margins_over_known_set"]
    assert loop["delay_margin"]["value"] < 0.9 * fixed["delay_margin"]["value"]
    (lost,) = certified(controller, replace(gained, input_gain=(0.5, 30.0))).values["margins_over_known_set"]
    assert lost["unstable_at_gain"] > 1.5


def test_margins_over_ranges_with_unmatched_remainders_belong_to_the_ranges():
    """k acts on both states, but the input only on one."""
    physical = PhysicalPlant(A=[[0, "k"], [-2, "-k"]], b=[0, 1], parameters=[Parameter("k", 2.0, tolerance=0.1)])
    plant = Plant(physical=physical, poles=[-1, -2])
    problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=2.0), reference=Sine(amplitude=1.0, frequency=1.0))
    for controller in (BaselineAlone(nominal=[4.0, 2.0]), Sampled(BaselineAlone(nominal=[4.0, 2.0]), T)):
        found = certify(problem, [controller], SIMULATION)
        (loop,) = found[controller.name].values["margins_over_known_set"]
        k = loop["delay_margin"]["parameters"]["k"]
        (column,) = table_1(problem, [controller], found).columns
        assert "over the parameters' ranges" in column.cells["margins"].text
        (said,) = (line.text for line in five(column, found[controller.name], None) if line.label == "margin")
        assert f"s in the ranges, at k = {k:g}" in said and "matched part" not in said


def test_no_claim_of_the_continuous_loop_is_left():
    """mu and its scale belong to the continuous loop, so Table 1 draws no conclusion from them."""
    controller = Sampled(Adrc(bandwidth=OMEGA), T)
    found = certify(PROBLEM, [controller], SIMULATION)
    assert not {"mu_parameters", "parameter_scale", "theta_destabilising"} & found[controller.name].values.keys()
    (column,) = table_1(PROBLEM, [controller], found).columns
    assert "mu" not in column.cells["modelling_error"].text
    assert column.cells["margins"].kind in ("exact", "estimate")
    assert "0.0568" in column.cells["margins"].text


def pi_problem(delay):
    plant = replace(PROBLEM.plant, input=PlantInput(delay=delay))
    return replace(PROBLEM, plant=plant), LinearFeedback(TransferFunction([4.0, 8.0], [1.0, 0.0]))


def output_problem(delay, nonlinear=None):
    plant = OutputPlant(TransferFunction([2.0], [1.0, 1.0]), nonlinear=nonlinear, input=PlantInput(delay=delay))
    model = OutputReferenceModel(TransferFunction([3.0], [1.0, 3.0]))
    return OutputProblem(plant=plant, reference_model=model, reference=Sine(amplitude=1.0, frequency=1.0))


RUNS = {
    "linear": pi_problem,
    "linear-output": lambda delay: (output_problem(delay), LinearOutput(TransferFunction([3.0, 3.0], [1.0, 0.0]))),
    "l1-output": lambda delay: (
        output_problem(delay),
        L1Output(m=3.0, gamma=4.0, filter=TransferFunction([20.0], [1.0, 20.0])),
    ),
}


@pytest.mark.parametrize("scheme", RUNS)
@pytest.mark.parametrize("discretization", ["euler", "midpoint"])
def test_a_run_beside_the_delay_margin_grows_or_decays(scheme, discretization):
    """With delays 20 % below and above the margin, a mode decays in 60 s or exceeds the error due to the command."""
    make = RUNS[scheme]
    problem, controller = make(0.0)
    margin = certified(Sampled(controller, T, discretization=discretization), problem).values["delay_margin"]
    grown = []
    for share in (0.8, 1.2):
        late, controller = make(share * margin)
        run = simulate(late, [Sampled(controller, T, discretization=discretization)], Simulation(t_end=60.0, dt=5e-3))
        e = np.abs(run[controller.name].envelope.e_max[:, 0])
        parts = [part.max() for part in np.array_split(e, 6)]
        grown.append(parts[-1] > 1.2 * parts[-2])
    assert grown == [False, True]


def test_f_is_left_out_of_the_sampled_loop():
    """As the assumption says, with f(t, y) the margins are the margins of the plant without f."""
    for controller in (
        Sampled(LinearOutput(TransferFunction([3.0, 3.0], [1.0, 0.0])), T),
        L1OutputPiecewiseConstant(sample_time=T, filter=TransferFunction([20.0], [1.0, 20.0])),
    ):
        with_f, without = (linearised(output_problem(0.0, f), controller).loop for f in ("0.5*sin(y)", None))
        assert with_f.radius(0.0) == without.radius(0.0)


def test_nothing_stays_of_the_continuous_loop():
    """A sampled adaptive law has its own linear loops; see test_sampled_margins.py."""
    found = certified(Sampled(Mrac(gamma=1e4), 0.01))
    for key in ("delay_margin_adapting", "gain_margin", "sensitivity_peak"):
        assert "in sampled-data form" in found.entry(key).of
    assert all("in sampled-data form" in loop["loop"] for loop in found.values["margins_over_known_set"])
