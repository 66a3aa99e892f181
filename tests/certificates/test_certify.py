"""Certificates of whole cases: the contract's keys, the values that are called guaranteed, and the message if nothing is
guaranteed."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from barbalat import (
    InputError,
    L1Adaptive,
    Mrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Sampled,
    TransferFunction,
    input_filter,
    simulate,
)
from barbalat.budget import Budget
from barbalat.cases.load import load_case
from barbalat.certificates.certify import certify
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.ideal import around_equilibrium, fast_adaptation, known_parameters
from barbalat.cli import main
from barbalat.laws import CompositeLearning
from barbalat.linear.margins import margins
from barbalat.linear.systems import series
from barbalat.papers.jafari_2013.section_v import variant
from barbalat.plants import PlantInput
from barbalat.signals import Constant
from barbalat.solvers.simulation import Simulation
from independent import refusal

SIMULATION = Simulation(t_end=60.0, dt=1e-4)


def test_json_of_the_paper_case(capsys):
    assert main(["certify", "paper", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    l1 = document["controllers"]["L1"]
    assert l1["condition"]["holds"] is True and l1["condition"]["limit"] == 1.0
    assert l1["condition"]["value_upper"] == pytest.approx(0.4301, abs=1e-4)
    for norm in ("W_b(1-C)", "sW_b"):
        ends = l1["norms"][norm]
        assert 0 < ends["lower"] <= ends["upper"] <= ends["lower"] * (1 + 1e-9)
    assert 0.0495 < l1["kappa_admissible"] < 0.05
    assert l1["kappa_max"] == pytest.approx(1 / (10 * 2.305242232582694), rel=1e-9)
    for key in ("nu_0", "error_bound", "adaptation_frequency", "gamma_max", "step_max", "delay_margin", "assumptions"):
        assert key in l1
    assert document["controllers"]["MRAC"]["error_bound"] == pytest.approx(6.6035, abs=1e-3)
    assert "norms" not in document["controllers"]["MRAC"] and "error_bound" not in document["controllers"]["Robust MRAC"]


def test_gain_and_step_limits_agree():
    """At gamma_max the limit on the step is the step of the run. Both follow from h omega_a = 2.83."""
    case = load_case("paper")
    first = certify(case.problem, (Mrac(gamma=1.0),), case.simulation)["MRAC"].values
    again = certify(case.problem, (Mrac(gamma=first["gamma_max"]),), case.simulation)["MRAC"].values
    assert again["step_max"] == pytest.approx(case.simulation.dt, rel=1e-9)


def test_a_step_that_the_solver_does_not_bear_is_said_beside_the_bound():
    """The run exceeds (9) although the solution of the equations does not, so the solver is the cause."""
    case = load_case("paper")
    controller = Mrac(gamma=1e6, projection=False)
    coarse, fine = Simulation(t_end=1.0, dt=1e-3), Simulation(t_end=1.0, dt=1e-6)
    found, resolved = (certify(case.problem, (controller,), at)["MRAC"] for at in (coarse, fine))
    assert "error_bound" in found.guaranteed and any("at dt = 0.001 s rk4 need not follow" in note for note in found.notes)
    assert not any("need not follow" in note for note in resolved.notes)
    bound = found.values["error_bound"]
    learning = replace(controller, gamma=200.0, learning=CompositeLearning(gamma_c=50.0, time_constant=0.1))
    (unknown,) = certify(case.problem, (learning,), coarse).values()
    assert unknown.values["step_max"] is None and "error_bound" in unknown.guaranteed
    assert any("no limit on the step is known" in note for note in unknown.notes)
    left, kept = (simulate(case.problem, [controller], at)["MRAC"] for at in (coarse, fine))
    assert left.diverged_at is not None or max(left.figures["max_abs_e"]) > bound
    assert max(kept.figures["max_abs_e"]) <= bound


def test_unmodelled_dynamics_take_the_guarantee_away():
    given = variant(input=PlantInput(actuator=TransferFunction([2500.0], [1.0, 100.0, 2500.0])))
    found = certify(given, (Mrac(gamma=1.0),), SIMULATION)["MRAC"]
    assert "error_bound" not in found.guaranteed
    assert found.entry("error_bound").why == "actuator"
    plain = certify(variant(), (Mrac(gamma=1.0),), SIMULATION)["MRAC"]
    assert found.values["delay_margin"] < plain.values["delay_margin"]  # the actuator's lag is used up


def test_the_adapting_loop_gets_the_input_dynamics_once():
    """The margin of the loop with an actuator is the margin of the plain loop in series with the actuator."""
    actuator = TransferFunction([2500.0], [1.0, 100.0, 2500.0])
    given = variant(input=PlantInput(actuator=actuator), reference=Constant(0.02))
    found = certify(given, (Mrac(gamma=1.0),), SIMULATION)["MRAC"].values["delay_margin_adapting"]
    plain = around_equilibrium(variant(), Mrac(gamma=1.0), 0.02)
    assert found == pytest.approx(margins(series(actuator.realise(), plain)).delay, rel=1e-9)


def test_a_delay_is_taken_off_the_margin():
    plain = certify(variant(), (Mrac(gamma=1.0),), SIMULATION)["MRAC"].values["delay_margin"]
    delayed = certify(variant(input=PlantInput(delay=0.1)), (Mrac(gamma=1.0),), SIMULATION)["MRAC"].values["delay_margin"]
    assert delayed == pytest.approx(plain - 0.1, rel=1e-9)


def test_theta_outside_the_set_and_a_failed_condition():
    outside = certify(variant(theta=[7.0, 0.0]), (Mrac(gamma=1.0),), SIMULATION)["MRAC"]
    assert "error_bound" not in outside.guaranteed and any("outside" in finding for finding in outside.findings)
    slow = certify(variant(), (L1Adaptive(gamma=1.0, filter=input_filter(0.06)),), SIMULATION)["L1"]
    assert slow.values["condition"]["holds"] is False
    assert "error_bound" not in slow.values and any("but must be below 1" in finding for finding in slow.findings)


def test_a_reference_without_a_bound_is_refused():
    class Unbounded:
        def __call__(self, t):
            return t

        before = __call__

    with pytest.raises(InputError, match="needs a reference with a known bound"):
        certify(variant(reference=Unbounded()), (Mrac(gamma=1.0),), SIMULATION)


def test_beside_a_delay_nothing_is_missing():
    """The keys are the same as without a delay. The peaks agree with a dense grid, and no margin over the set exceeds that at
    theta."""
    delay, controllers = 0.01, (Mrac(gamma=1.0), L1Adaptive(gamma=1.0, filter=input_filter(0.1)))
    plain = certify(variant(), controllers, SIMULATION)
    delayed = certify(variant(input=PlantInput(delay=delay)), controllers, SIMULATION)
    for name, found in delayed.items():
        values, without = found.values, plain[name].values
        wanted = {"delay_margin", "phase_margin", "gain_margin", "gain_reduction_margin", "sensitivity_peak"}
        assert wanted <= set(values) and "complementary_sensitivity_peak" in values
        assert values["delay_margin"] == pytest.approx(without["delay_margin"] - delay, rel=1e-9)
        assert values["phase_margin"] < without["phase_margin"]
        for entry in values["margins_over_known_set"]:
            assert set(entry["unlimited"]) | set(entry) >= {"phase_margin", "gain_margin", "gain_reduction_margin"}
    plant = variant().plant
    for name, loop in (
        ("MRAC", known_parameters(plant, plant.theta)),
        ("L1", fast_adaptation(plant, input_filter(0.1).realise())),
    ):
        w = np.geomspace(1e-6, 1e4, 400_000)
        L = loop.response(w) * np.exp(-1j * w * delay)
        values = delayed[name].values
        assert values["sensitivity_peak"] == pytest.approx(np.abs(1 / (1 + L)).max(), rel=2e-6)
        assert values["complementary_sensitivity_peak"] == pytest.approx(np.abs(L / (1 + L)).max(), rel=2e-6)
        assert values["margins_over_known_set"][0]["gain_margin"]["value"] <= values["gain_margin"]


def test_the_bounds_follow_from_what_is_shown(capsys):
    """(9), (10) and the Lyapunov equation follow from the JSON and the case's numbers alone. The tolerance 1e-9 is for outward
    rounding."""
    assert main(["certify", "paper", "--json"]) == 0
    controllers = json.loads(capsys.readouterr().out)["controllers"]
    mrac, l1 = controllers["MRAC"], controllers["L1"]
    A_m, theta, k_0, gammas = np.array([[0, 1], [-0.3, -1]]), np.array([4, -3]), 4, {"MRAC": 1, "L1": 1e4}
    for name, found in (("MRAC", mrac), ("L1", l1)):
        P = np.array(found["P"])
        np.testing.assert_allclose(P @ A_m + A_m.T @ P, -np.eye(2), atol=1e-13)
        assert found["lambda_min"] <= np.linalg.eigvalsh(P)[0] == pytest.approx(found["lambda_min"], rel=1e-9)
        assert found["theta_max"] == 10 and found["bounds"]["r"] == pytest.approx(50, rel=1e-12)
        nu_0 = np.linalg.norm(theta) / np.sqrt(found["lambda_min"])  # theta_hat(0) = 0
        assert found["nu_0"] == pytest.approx(nu_0, rel=1e-9) and found["nu_0"] >= nu_0
        adaptation = found["nu_0"] / np.sqrt(gammas[name])
        if name == "MRAC":
            assert found["error_bound"] == pytest.approx(adaptation, rel=1e-9)
        else:
            N, theta_max, bounds = found["norms"]["W_b(1-C)"]["upper"], found["theta_max"], found["bounds"]
            bound = (adaptation + N * (theta_max * bounds["x_m"] + k_0 * bounds["r"])) / (1 - N * theta_max)
            assert found["error_bound"] == pytest.approx(bound, rel=1e-9)
        assert {"lambda_min", "theta_max", "bounds"} <= set(found["guaranteed"]) and "P" not in found["guaranteed"]


def test_the_bound_of_the_model_holds_along_a_run():
    """The bound holds for the simulated x_m under the paper's command. It covers every command below 50, so it may be much larger
    than x_m."""
    case = load_case("paper")
    (result,) = simulate(case.problem, [Mrac(gamma=1.0)], Simulation(t_end=60.0, dt=1e-3)).values()
    bound = certify(case.problem, (Mrac(gamma=1.0),), SIMULATION)["MRAC"].values["bounds"]["x_m"]
    assert np.abs(result.x_m).max() <= bound <= 3 * np.abs(result.x_m).max()


def test_theta_max_is_rounded_up():
    """The float nearest to 0.1 + 0.1 + 0.7 and NumPy's sum are both below the sum of the three floats."""
    box = ParameterBox(lower=[-0.1, 0.0, -0.5], upper=[0.1, 0.1, 0.7])
    exact = Fraction(0.1) + Fraction(0.1) + Fraction(0.7)
    assert Fraction(box.theta_max) >= exact > Fraction(float(box.upper.sum()))


def test_sampling_leaves_what_the_problem_alone_decides():
    controller = Sampled(controller=Mrac(gamma=1.0), sample_time=1e-3, discretization="midpoint")
    (found,) = certify(variant(), (controller,), SIMULATION).values()
    assert {"lambda_min", "theta_max", "bounds"} <= found.guaranteed and "error_bound" not in found.guaranteed


def test_a_theta_outside_the_set_leaves_what_the_problem_alone_decides():
    found = certify(variant(theta=[40.0, -3.0]), (Mrac(gamma=1.0),), SIMULATION)["MRAC"]
    assert {"lambda_min", "theta_max", "bounds"} == set(found.guaranteed)
    shown = {row.quantity: row for row in found.rows}
    assert shown["sup |r|"].kind == "guaranteed" and shown["P"].kind == ""
    assert float(shown["lambda_min"].value) <= found.values["lambda_min"]


def test_a_controller_of_another_measurement_is_refused():
    output, state = load_case("l1-output"), load_case("first-order")
    assert "output" in refusal(lambda: certify(output.problem, [Mrac(gamma=1.0)], output.simulation))
    assert "output" in refusal(lambda: certify(state.problem, [output.controllers[0]], state.simulation))


def test_margins_that_fail_take_nothing_with_them(monkeypatch, certified):
    """The bound (9) depends on no linear loop. A margin that fails is missing, and the reason is stated."""
    case, whole = certified("paper")

    def failing(*_):
        raise ValueError("f(a) and f(b) must have different signs")

    for name in ("margin_values.margins", "worst_case.margins"):
        monkeypatch.setattr(f"barbalat.certificates.linear_loops.{name}", failing)
    for worst in (over_known_set._worst_at_rest, over_known_set._worst_filtered):
        worst.cache_clear()
    for name, found in certify(case.problem, case.controllers, case.simulation).items():
        assert found.failure == "" and found.guaranteed == whole[name].guaranteed
        for key in ("delay_margin", "margins_over_known_set"):
            entry = found.entry(key)
            assert entry is not None and not entry.applies and "different signs" in entry.why


def test_a_loop_whose_pole_lies_on_the_axis_is_certified():
    """A_m + b theta' is undamped at a corner of the known set, so the linear loop is infinite at a frequency of the search."""
    plant = Plant(A_m=[[0.0, 1.0], [-2.0, -2.0]], b=[0.0, 1.0], theta=[0.0, -1.0])
    known = ParameterBox([-2.0, -2.0], [0.575, 2.0])
    problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=2.0), reference=Constant(1.0), uncertainty=known)
    found = certify(
        problem, (Mrac(gamma=10.0), L1Adaptive(gamma=10.0, filter=input_filter(0.02))), Simulation(t_end=1.0, dt=1e-3)
    )
    for one in found.values():
        assert "error_bound" in one.guaranteed and one.entry("delay_margin").applies


def test_a_plant_whose_certificates_would_take_too_long_is_refused_before_they_are_begun():
    n = 100
    problem = Problem(
        plant=Plant(A_m=-np.diag(np.arange(1.0, n + 1)), b=np.ones(n), theta=np.zeros(n), x0=np.zeros(n)),
        reference_model=ReferenceModel(k_0=1.0),
        reference=Constant(1.0),
        uncertainty=ParameterBox(lower=-np.ones(n), upper=np.ones(n)),
    )
    with Budget(seconds=60.0), pytest.raises(InputError, match=r"^the plant has 100 states, and 1 certificate would take about"):
        certify(problem, Mrac(gamma=1.0), Simulation(t_end=1.0, dt=1e-4))
