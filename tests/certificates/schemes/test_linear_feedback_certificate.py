"""Certificates of linear controllers: the bound compared with simulations, the norm compared with an impulse response, and the
keys."""

import numpy as np
import pytest
from scipy import signal as scipy_signal

from barbalat import InputError, L1Adaptive, LinearFeedback, Sampled, TransferFunction, input_filter, simulate_ensemble
from barbalat.certificates.certify import certify
from barbalat.certificates.schemes import linear_feedback
from barbalat.designs import hinf_feedback, pi_feedback
from barbalat.papers.jafari_2013.section_v import variant
from barbalat.plants import PlantInput
from barbalat.signals import Sine
from barbalat.solvers.simulation import Simulation

SIMULATION = Simulation(t_end=60.0, dt=1e-4)


def test_the_norm_against_an_impulse_response(section_v):
    """int |g_i| by quadrature on 400,000 points over 40 s, after which the slowest mode, with a pole near 1/(8 delay), has long
    decayed."""
    given = pi_feedback(section_v.known, unmodelled_delay=0.02)
    equations = given.bind(section_v.known)
    loop = linear_feedback.loop_at(np.zeros(2), equations, section_v.known)
    closed = scipy_signal.StateSpace(loop.A - np.outer(loop.B, loop.C), loop.B[:, None], np.eye(2, 3), np.zeros((2, 1)))
    t = np.linspace(0, 40, 400_001)
    _, g = scipy_signal.impulse(closed, T=t)
    by_quadrature = np.trapezoid(np.abs(g), t, axis=0).max()
    found = linear_feedback.loop_of(section_v, given).error_norm()
    assert found.lower <= found.upper
    assert by_quadrature == pytest.approx(found.upper, rel=1e-4)


@pytest.mark.dear
def test_the_bound_holds_over_the_known_set():
    """With 48 random commands and theta, some at the corners of the box, every step of every run stays below the bound."""
    rng = np.random.default_rng(11)
    thetas = [np.array([p, q]) for p in (-5.0, 5.0) for q in (-5.0, 5.0)] + [rng.uniform(-5, 5, 2) for _ in range(8)]
    given = variant()
    for controller in (pi_feedback(given.known, unmodelled_delay=0.01), pi_feedback(given.known, unmodelled_delay=0.03)):
        bound = certify(given, (controller,), SIMULATION, keys=("error_bound",))["PI"].values["error_bound"]
        for frequency in (0.1, 0.5, 2.0, 6.0):
            members = [(variant(theta=theta, reference=Sine(50.0, frequency)), controller) for theta in thetas]
            largest = simulate_ensemble(members, Simulation(t_end=30.0, dt=1e-3)).metrics.max_abs_e
            assert largest.max() < bound
            assert largest.max() > 1e-4 * bound  # the statement concerns these runs


@pytest.mark.dear
def test_keys_and_what_is_guaranteed():
    pytest.importorskip("slycot")
    given = variant()
    found = certify(given, (hinf_feedback(given.known, unmodelled_delay=0.01),), SIMULATION)["H-infinity"]
    of_the_set = {"norms", "condition", "error_bound", "error_bound_worst", "error_bound_command"}
    assert found.guaranteed == {*of_the_set, "state_bound", "control_bound"}
    v = found.values
    assert v["condition"]["holds"] and v["condition"]["of"] == "W_b S"
    assert v["delay_margin"] > 0.01
    assert 1 < v["sensitivity_peak"] < 2 and 1 < v["complementary_sensitivity_peak"] < 2
    assert max(v["mu_parameters"], v["mu_dynamics"]) <= v["mu"] <= v["mu_parameters"] + v["mu_dynamics"]
    assert v["parameter_scale"] == 1 / v["mu_parameters"]
    # the small-gain condition in the L1 norm is at least as strict as exact stability of the same family
    assert v["parameter_scale"] > 1 / v["condition"]["value_upper"]


def test_theta_destabilising_is_on_the_border():
    given = variant()
    controller = pi_feedback(given.known, unmodelled_delay=0.02)
    found = certify(given, (controller,), SIMULATION, keys=("theta_destabilising",))["PI"]
    theta = np.array(found.values["theta_destabilising"])
    for factor, sign in ((0.999, -1), (1.001, 1)):
        loop = linear_feedback.loop_at(factor * theta, controller.bind(given.known), given.known)
        assert np.sign(np.linalg.eigvals(loop.A - np.outer(loop.B, loop.C)).real.max()) == sign


def test_mu_of_the_l1_limit_stands_beside_its_condition():
    """The condition is sufficient in the L1 norm, and mu is exact for constant parameters, so mu always allows more."""
    controller = L1Adaptive(gamma=1.0, filter=input_filter(0.02))
    found = certify(variant(), (controller,), SIMULATION, keys=("parameter_scale", "condition"))["L1"].values
    assert found["parameter_scale"] > 1 / found["condition"]["value_upper"]


def test_an_unstable_nominal_loop_says_so():
    given = variant()
    positive = LinearFeedback(controller=TransferFunction([-50.0], [1.0]))
    found = certify(given, (positive,), SIMULATION)["Linear"]
    assert "error_bound" not in found.values and "mu_parameters" not in found.values
    assert any("unstable" in finding for finding in found.findings)


@pytest.mark.dear
def test_input_dynamics_take_the_guarantee_away_and_sampling_gives_another():
    controller = pi_feedback(variant().known, unmodelled_delay=0.01)
    late = variant(input=PlantInput(delay=0.01))
    assert "error_bound" not in certify(late, (controller,), SIMULATION, keys=("error_bound",))["PI"].guaranteed
    for given in (variant(), late):  # the norm of the sampled loop with its delay; see test_sampled_response.py
        found = certify(given, (sampled(controller),), SIMULATION, keys=("error_bound", "error_bound_held"))["PI"]
        assert {"error_bound", "error_bound_held"} <= found.guaranteed
    left, whole = (certify(given, (controller,), SIMULATION, keys=("delay_margin",))["PI"] for given in (late, variant()))
    assert left.values["delay_margin"] == pytest.approx(whole.values["delay_margin"] - 0.01)


def sampled(controller):
    return Sampled(controller=controller, sample_time=1e-3, discretization="euler")


def test_settings_are_checked():
    proper = TransferFunction([1.0], [1.0, 1.0])
    for arguments, word in (
        ({"controller": TransferFunction([1.0, 0.0, 0.0], [1.0, 1.0])}, "proper"),
        ({"controller": 3.0}, "controller"),
        ({"controller": proper, "unmodelled": TransferFunction([1.0], [1.0, -1.0])}, "stable"),
        ({"controller": proper, "name": ""}, "name"),
    ):
        with pytest.raises(InputError, match=word):
            LinearFeedback(**arguments)
    for field in ("output", "nominal"):
        with pytest.raises(InputError, match=field):
            LinearFeedback(controller=proper, **{field: [1.0, 2.0, 3.0]}).bind(variant().known)
