"""The names of estimates in pictures and tables, and their ideal values."""

from dataclasses import replace

import pytest

from barbalat import DirectMrac, Mrac, NetworkMrac, ParameterBox, Problem, Sampled, Simulation, input_filter, simulate
from barbalat.adaptation.modifications import FixedSigma
from barbalat.controllers import L1PiecewiseConstant
from barbalat.plants import PlantInput
from barbalat.run.results.estimates import estimates_of
from barbalat.run.results.picture import panels

AT = Simulation(t_end=0.5, dt=2.0**-7)


@pytest.fixture
def problem(problems) -> Problem:
    given = problems[2]
    return replace(given, plant=replace(given.plant, input=PlantInput(gain=2.0)), uncertainty=None)


def test_gains_are_called_gains_and_weights_weights(problem):
    """With omega = 2 the ideal gains are theta/2 and k_0/2. For weights no ideal values are known."""
    made = [DirectMrac(gamma=2.0), NetworkMrac(gamma=2.0, leakage=FixedSigma(0.1), neurons=3), Mrac(gamma=2.0)]
    direct, network, mrac = simulate(problem, made, AT).values()
    theta, k_0 = problem.plant.theta, problem.reference_model.k_0
    assert [one.name for one in estimates_of(direct)] == ["k_x,1", "k_x,2", "k_r"]
    assert [one.true for one in estimates_of(direct)] == pytest.approx([*(theta / 2), k_0 / 2])
    assert estimates_of(direct)[2].value.tolist() == direct.reported["k_r_hat"][:, 0].tolist()
    assert [one.name for one in estimates_of(network)] == ["W_0", "W_1", "W_2", "W_3"]  # a list of 12 inner ones is not shown
    assert {one.true for one in estimates_of(network)} == {None}
    assert [(one.name, one.true) for one in estimates_of(mrac)] == [("theta_1", theta[0]), ("theta_2", theta[1])]


def test_the_estimate_of_an_unknown_input_gain_is_called_omega(problem):
    """The estimate has this name in tables, pictures and findings. The columns of files keep their names."""
    narrow = ParameterBox(lower=[-0.1] * len(problem.plant.theta), upper=[0.1] * len(problem.plant.theta))
    given = replace(problem, uncertainty=narrow, input_gain=(0.9, 1.1))
    run = simulate(given, [Mrac(gamma=200.0)], AT)["MRAC"]
    assert [(one.name, one.true) for one in estimates_of(run)][-1] == ("omega", 2.0)
    assert r"$\hat{\omega}$" in {one.label for panel in panels([run]) for one in panel.series}
    said = " ".join(run.adapting.warnings)
    assert "omega_hat is at its projection bounds" in said and "theta_hat_3" not in said
    assert "theta_hat_3" in run.columns()


def test_the_picture_has_the_feedforward_beside_the_feedback(problem):
    (run,) = simulate(problem, [DirectMrac(gamma=2.0)], AT).values()
    shown = [one for panel in panels([run])[-2:] if panel.title.startswith("Estimates") for one in panel.series]
    assert [one.label for one in shown] == [r"$\hat{k}_{x,1}$", r"$\hat{k}_{x,2}$", r"$\hat{k}_{r}$"]


def test_a_law_that_estimates_no_parameters_shows_what_it_does_estimate(problem):
    flown = L1PiecewiseConstant(sample_time=2.0**-6, filter=input_filter(0.05))
    (run,) = simulate(replace(problem, plant=replace(problem.plant, input=None)), [flown], AT).values()
    assert [one.name for one in estimates_of(run)] == ["sigma_1", "sigma_2"] and run.theta_hat.shape[1] == 0
    labels = {one.label for panel in panels([run]) for one in panel.series}
    assert {r"$\hat{\sigma}_{1}$", r"$\hat{\sigma}_{2}$"} <= labels


def test_euler_s_steps_report_what_the_continuous_law_does(problem):
    sampled = Sampled(DirectMrac(gamma=2.0), 2.0**-5, discretization="euler")
    (run,) = simulate(problem, [sampled], AT).values()
    assert run.figures["k_r_hat_final"] == run.reported["k_r_hat"][-1].tolist()
    assert estimates_of(run)[-1].true == pytest.approx(problem.reference_model.k_0 / 2)
