"""What is guaranteed of the MRAC with a network, against runs, and the level that its proof rests on, against brute force."""

from dataclasses import replace

import numpy as np
import pytest

from barbalat import (
    NetworkMrac,
    Plant,
    PlantInput,
    Problem,
    ReferenceModel,
    Sampled,
    Simulation,
    Square,
    Terms,
    certify,
    simulate,
)
from barbalat.adaptation.modifications.epsilon_modification import EpsilonModification
from barbalat.adaptation.modifications.fixed_sigma import FixedSigma
from barbalat.certificates.bounds.network import ErrorBoundCase, NetworkLaw
from barbalat.certificates.table_1 import table_1
from barbalat.signals import Sine

AT = Simulation(t_end=20.0, dt=2e-3)
A_M, B = np.array([[0.0, 1.0], [-1.0, -1.4]]), np.array([0.0, 1.0])
BOUNDED = Plant(A_m=A_M, b=B, theta=[0.5, 1.0, -0.4], regressor=Terms(terms=["sin(x1)", "tanh(x2)", "cos(x1)"]))
DAMPED = Plant(A_m=A_M, b=B, theta=[-0.3, -0.4])
SQUARE = Square(amplitude=1.0, frequency=0.5)
SIGMA, NU = FixedSigma(0.01), EpsilonModification(nu=0.1)
LEAKAGES = pytest.mark.parametrize("leakage", [SIGMA, NU], ids=["sigma", "e"])


def problem_of(plant, **more):
    return Problem(plant=plant, reference_model=ReferenceModel(k_0=1.0), reference=SQUARE, **more)


def level_along(run, controller):
    """e'P e + |W_hat|^2/gamma + |V_hat|^2/gamma_v at every instant of the record."""
    P, gamma_v = run.problem.known.P, controller.gamma_v or controller.gamma
    V = run.reported["V_hat"]
    return np.einsum("ki,ij,kj->k", run.e, P, run.e) + (run.theta_hat**2).sum(1) / controller.gamma + (V**2).sum(1) / gamma_v


@LEAKAGES
@pytest.mark.parametrize("plant", [BOUNDED, DAMPED], ids=["bounded phi", "phi = x"])
@pytest.mark.short(kept=lambda plant, leakage: plant.is_linear == (leakage is SIGMA))
def test_the_bounds_hold_beside_a_matched_disturbance(plant, leakage):
    problem = problem_of(plant, disturbance=Sine(0.3, 1.7))
    controller = NetworkMrac(gamma=5.0, gamma_v=40.0, leakage=leakage, neurons=4)
    values = (found := certify(problem, [controller], AT)[controller.name]).values
    assert {"error_bound", "W_hat_bound", "V_hat_bound", "control_bound"} <= found.guaranteed
    (run,) = simulate(problem, [controller], AT).values()
    assert max(run.figures["max_abs_e"]) <= values["error_bound"]
    assert run.figures["max_abs_u"] <= values["control_bound"]
    assert np.abs(run.theta_hat).max() <= values["W_hat_bound"]
    assert np.linalg.norm(run.reported["V_hat"], axis=1).max() <= values["V_hat_bound"]
    cells = table_1(problem, [controller], {controller.name: found}).columns[0].cells
    assert [cells[key].kind for key in ("stability", "transient", "estimates")] == ["guaranteed"] * 3
    assert cells["tracking"].kind == "does not apply"
    case = ErrorBoundCase.of(problem, controller.bind(problem.known))
    A = plant.A if plant.is_linear else plant.A_m
    assert level_along(run, controller).max() <= case.level(A, case.uncertainty(values["error_bound"]))


@pytest.mark.parametrize("seed", range(8))
def test_the_highest_level_is_the_largest_where_it_can_grow(seed):
    """Drawn points of lambda s^2 + 2 w omega^2 <= 2 |mu| F lie below it, and the best comes near: 2 % of 40 000 of them."""
    random = np.random.default_rng(seed)
    gamma, gamma_v, F, lowest, p, value = 10 ** random.uniform(-1, 1, 6)
    highest, near = 2 * lowest, 0.0
    for law in (
        NetworkLaw(gamma=gamma, gamma_v=gamma_v, outer_weights=4, start=0.0, sigma=value, nu=None),
        NetworkLaw(gamma=gamma, gamma_v=gamma_v, outer_weights=4, start=0.0, sigma=None, nu=value),
    ):
        s = np.concatenate([[0.0, 2 * p * F / lowest], random.uniform(0, 2 * p * F / lowest, 40_000)])
        if law.nu is None:
            omega_2 = np.maximum(0, 2 * p * F * s - lowest * s**2) / (2 * value)
        else:
            omega_2 = np.maximum(0, F - lowest * s / (2 * p)) / value  # |mu| = p s, where it allows the most
        near = (highest * s**2 + omega_2 / min(gamma, gamma_v)).max()
        assert near <= law.highest_level(F, lowest, highest, p) <= 1.02 * near


@LEAKAGES
def test_no_weight_leaves_the_e_modification_s_bound_whatever_acts(leakage):
    """A delay that the loop does not bear, and a limit: with the e-modification |W_i| <= 1/nu still, and comes near."""
    leakage = EpsilonModification(nu=2.0) if leakage is NU else leakage
    plant = Plant(A_m=A_M, b=B, theta=[1.5, 2.0], input=PlantInput(delay=0.4, saturation=[-4.0, 4.0]), x0=[2.0, 0.0])
    problem, controller = problem_of(plant), NetworkMrac(gamma=3.0, leakage=leakage, neurons=4)
    found = certify(problem, [controller], AT)[controller.name]
    assert "error_bound" not in found.guaranteed
    if leakage is SIGMA:
        assert not {"W_hat_bound", "V_hat_bound", "control_bound"} & found.guaranteed
        return
    (run,) = simulate(problem, [controller], AT).values()
    assert 0.4 / 2.0 < np.abs(run.theta_hat).max() <= found.values["W_hat_bound"] == pytest.approx(1 / 2.0)
    assert np.linalg.norm(run.reported["V_hat"], axis=1).max() <= found.values["V_hat_bound"]
    assert run.figures["max_abs_u"] <= found.values["control_bound"]


@LEAKAGES
def test_where_the_model_alone_does_not_hold_the_plant_nothing_is_claimed_of_e(leakage):
    problem = problem_of(Plant(A_m=A_M, b=B, theta=[3.0, 3.0]))
    controller = NetworkMrac(gamma=50.0, leakage=leakage)
    found = certify(problem, [controller], AT)[controller.name]
    assert "error_bound" not in found.values and "outweighs" in found.entry("error_bound").why
    column = table_1(problem, [controller], {controller.name: found}).columns[0]
    assert not {key for key in ("stability", "tracking", "transient") if column.cells[key].kind == "guaranteed"}


@pytest.mark.full
def test_the_e_modification_s_output_is_a_bounded_disturbance_of_a_stable_plant():
    """Where A is Hurwitz and P does not show it: ||(sI - A)^-1 b||_1 times what acts; sigma-modification has no bound there."""
    plant = Plant(A_m=A_M, b=B, theta=[-8.0, 1.0])
    problem = problem_of(plant)
    assert np.linalg.eigvals(plant.A).real.max() < 0
    assert np.linalg.eigvalsh(-(problem.known.P @ plant.A + plant.A.T @ problem.known.P))[0] < 0
    sigma, e = NetworkMrac(gamma=5.0, leakage=SIGMA, name="sigma"), NetworkMrac(gamma=5.0, leakage=NU, name="e")
    found = certify(problem, [sigma, e], AT)
    assert "error_bound" in found["e"].guaranteed and "error_bound" not in found["sigma"].values
    (run,) = simulate(problem, [e], AT).values()
    assert max(run.figures["max_abs_e"]) <= found["e"].values["error_bound"]


def test_what_is_not_of_the_proof_takes_the_guarantee_away():
    controller = NetworkMrac(gamma=5.0, leakage=SIGMA, neurons=2)
    for changed in ({"input": PlantInput(delay=0.01)}, {"input": PlantInput(gain=0.9)}):
        problem = problem_of(replace(BOUNDED, **changed))
        assert not {"error_bound", "W_hat_bound"} & certify(problem, [controller], AT)[controller.name].guaranteed
    sampled = Sampled(controller, 0.01, discretization="euler")
    found = certify(problem_of(BOUNDED), [sampled], AT)[controller.name]
    assert not {"error_bound", "W_hat_bound", "control_bound"} & found.guaranteed
    assert np.shape(found.values["V_hat0"]) == (3, 2)  # recorded
