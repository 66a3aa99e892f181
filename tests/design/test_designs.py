"""The designs, compared with python-control's synthesis and norms, with the weights that they have to satisfy, and by hand."""

import math
import re
import sys
import warnings
from dataclasses import fields

import control
import numpy as np
import pytest

from barbalat.cases.load import load_case, parse_case
from barbalat.certificates.linear_loops.over_known_set import robustness
from barbalat.certificates.schemes import linear_feedback
from barbalat.controllers import LinearFeedback
from barbalat.design import (
    default_delay,
    delay_weight,
    design_model,
    hinf_feedback,
    mixed_sensitivity,
    pi_controller,
    pi_feedback,
)
from barbalat.design.hinf import BANDWIDTH_SHARE
from barbalat.linear.margins import margins
from barbalat.linear.peaks import PEAK_PRECISION, peak_gain
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.problem.regressors import Linear
from independent import refusal

W = np.geomspace(1e-3, 1e5, 2000)


@pytest.fixture(scope="module")
def model(section_v):
    return design_model(section_v.known)[1]


@pytest.mark.parametrize("delay", [0.1, 0.01, 1e-3])
def test_the_weights_are_met(model, delay):
    """The three curves are below 1 at every frequency of a grid, from the definitions of S and T."""
    pytest.importorskip("slycot")
    found = mixed_sensitivity(model, delay)
    K, G, s = found.controller.response(W / delay), model.at(1j * W / delay), 1j * W / delay
    S = 1 / (1 + G * K)
    rows = np.abs([found.W_S.at(s) * S, found.W_KS * K * S, found.W_T.at(s) * G * K * S])
    total = np.sqrt((rows**2).sum(axis=0)).max()
    assert total <= found.norm * (1 + 1e-6) <= 1 + 1e-6
    assert total >= 0.99 * found.norm  # the grid contains nearly all of the peak
    assert margins(series(found.controller, model)).delay > delay  # |W_T T| <= 1 is sufficient


def series(K: StateSpace, G: TransferFunction) -> StateSpace:
    plant = G.realise()
    A = np.block([[K.A, np.zeros((K.order, plant.order))], [np.outer(plant.B, K.C), plant.A]])
    return StateSpace(A, np.concatenate([K.B, plant.B * K.D]), np.concatenate([np.zeros(K.order), plant.C]), 0.0)


def test_against_python_controls_synthesis(model):
    """At the resulting bandwidth the optimal norm of control.mixsyn is below the package's norm. Without the back-off that norm
    is 1."""
    pytest.importorskip("slycot")
    delay = 0.02
    found = mixed_sensitivity(model, delay)
    assert optimal(model, found) < found.norm <= 1
    limit = mixed_sensitivity(model, delay, bandwidth=found.bandwidth / BANDWIDTH_SHARE * 0.999)
    assert optimal(model, limit) == pytest.approx(1.0, abs=0.01)  # bisection to 1 %
    assert "bandwidth" in refusal(lambda: mixed_sensitivity(model, delay, bandwidth=found.bandwidth / BANDWIDTH_SHARE * 1.05))


def optimal(model, found) -> float:
    G, W_S, W_T = (control.ss(control.tf(part.num, part.den)) for part in (model, found.W_S, found.W_T))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # python-control's own use of connect
        _, _, (gamma, _) = control.mixsyn(G, W_S, control.ss([], [], [], [[found.W_KS]]), W_T)
    return float(gamma)


def test_an_unstable_and_a_higher_order_model():
    pytest.importorskip("slycot")
    for given in (TransferFunction([2.0], [1.0, -1.0]), TransferFunction([4.0], [1.0, 2.0, 1.0, 0.5])):
        found = mixed_sensitivity(given, 0.05)
        closed = np.linalg.eigvals(closed_loop(series(found.controller, given)))
        assert closed.real.max() < 0
        assert margins(series(found.controller, given)).delay > 0.05


def closed_loop(loop: StateSpace) -> np.ndarray:
    return loop.A - np.outer(loop.B, loop.C)


def test_what_cannot_be_met_is_refused():
    pytest.importorskip("slycot")
    assert "imaginary axis" in refusal(lambda: mixed_sensitivity(TransferFunction([1.0], [1.0, 0.0]), 0.1))
    assert "too long" in refusal(lambda: mixed_sensitivity(TransferFunction([2.0], [1.0, -1.0]), 10.0))
    assert "unmodelled_delay" in refusal(lambda: mixed_sensitivity(TransferFunction([2.0], [1.0, 1.0]), -1.0))


def test_a_missing_package_is_named(model, monkeypatch):
    monkeypatch.setitem(sys.modules, "slycot", None)
    message = refusal(lambda: mixed_sensitivity(model, 0.01))
    assert "slycot" in message
    assert "barbalat[robust]" in message


def test_the_delay_weight_covers_the_delay():
    x = np.geomspace(1e-4, 1e4, 200_001)
    for delay in (1.0, 0.7, 0.1):  # also with shorter delays
        assert (np.abs(np.exp(-1j * delay * x) - 1) <= np.abs(delay_weight(1.0).at(1j * x)) * (1 + 1e-12)).all()
    tight = np.abs(np.exp(-1j * 0.5) - 1) / np.abs(delay_weight(1.0).at(0.5j))
    assert tight == pytest.approx(1.0, abs=1e-3)


def test_pi_on_an_integrator_is_simc():
    """For G = 1/s with the delay, K_c = 1/(2 delay) and T_i = 8 delay, up to the integral's share in the gain at the
    crossover."""
    delay = 0.1
    K = pi_controller(TransferFunction([1.0], [1.0, 0.0]), delay)
    share = abs(1 + 1 / (1j * 8 * delay / (2 * delay)))
    assert K.num[0] == pytest.approx(1 / (2 * delay) / share, rel=1e-12)
    assert K.num[0] / K.num[1] == pytest.approx(8 * delay, rel=1e-12)
    found = margins(series(K.realise(), TransferFunction([1.0], [1.0, 0.0])))
    assert found.delay > delay
    assert found.crossovers == pytest.approx((1 / (2 * delay),), rel=1e-9)


def test_pi_follows_the_sign_of_the_model_and_refuses_what_it_cannot_stabilise():
    assert pi_controller(TransferFunction([-3.0], [1.0, 1.0]), 0.1).num[0] < 0
    assert "does not stabilise" in refusal(lambda: pi_controller(TransferFunction([1.0], [1.0, 1.0, 1.0, 1.0]), 0.001))


def test_the_default_delay_is_a_tenth_of_the_fastest_time_constant(section_v, problems):
    """Section V's box has s^2 + (1 - theta_2) s + 0.3 - theta_1. The largest root at the corners belongs to theta = (5, -5)."""
    fastest = np.abs(np.roots([1.0, 6.0, -4.7])).max()
    assert default_delay(section_v.known) == pytest.approx(0.1 / fastest, rel=1e-12)


def test_the_loop_is_the_one_that_was_designed(section_v):
    """Broken at the plant's input with the nominal theta = 0, the loop is L = K W_m. The peaks equal the ones from
    python-control."""
    known = section_v.known
    given = pi_feedback(known, unmodelled_delay=0.02)
    _, model = design_model(known)
    loop = linear_feedback.loop_at(np.zeros(2), given.bind(known), known)
    K = given.controller
    np.testing.assert_allclose(loop.response(W), K.response(W) * model.at(1j * W), rtol=1e-9)
    L = control.ss(K.A, K.B[:, None], K.C[None], K.D) * control.ss(control.tf(model.num, model.den))
    T = control.linfnorm(control.feedback(L, 1))[0]
    closed = StateSpace(closed_loop(loop), loop.B, loop.C, 0.0)
    assert peak_gain(closed).gain == pytest.approx(T, rel=3 * PEAK_PRECISION)


@pytest.mark.parametrize("case", ["lateral-aircraft", "wing-rock", "f16-short-period"])
def test_plants_with_several_inputs_or_nonlinear_terms_are_refused(case):
    """The design itself rejects several inputs and a nonlinear regressor in one sentence. It takes an unknown input gain as 1."""
    known = load_case(case).problem.known
    if known.inputs == 1 and isinstance(known.matched.regressor, Linear):
        assert pi_feedback(known).bind(known).K.order == 1
    else:
        assert re.search("input|regressor", refusal(lambda: pi_feedback(known)))


def test_a_nominal_set_off_zero(section_v):
    """The centre of the box is cancelled. There the loop is L = K W_m plus theta_0'(sI - A_m - b theta_0')^-1 b, and it is
    stable."""
    known = section_v.known
    shifted = type(known)(
        A_m=known.A_m,
        b=known.b,
        k_0=known.k_0,
        x0=known.x0,
        estimate_set=type(known.estimate_set)(lower=[3.0, -4.0], upper=[5.0, -2.0]),
    )
    equations = pi_feedback(shifted, unmodelled_delay=0.02).bind(shifted)
    assert equations.theta_0.tolist() == [4.0, -3.0]
    _, model = design_model(shifted)
    closed = np.sort_complex(np.linalg.eigvals(closed_loop(linear_feedback.loop_at(equations.theta_0, equations, shifted))))
    K = pi_controller(model, 0.02)
    by_hand = np.roots(np.polyadd((K * model).den, (K * model).num))
    np.testing.assert_allclose(closed, np.sort_complex(by_hand), rtol=1e-8)


def test_hinf_tolerates_more_than_pi_for_the_same_delay(section_v):
    """The purpose of the synthesis is to use the bandwidth that the delay allows. (pi_controller keeps a margin.)"""
    pytest.importorskip("slycot")
    known, delay = section_v.known, 0.02
    findings: list[str] = []
    scale = {}
    for make in (hinf_feedback, pi_feedback):
        given = make(known, unmodelled_delay=delay)
        loop = linear_feedback.loop_at(np.zeros(2), given.bind(known), known)
        values = robustness(loop, known.estimate_set, given.unmodelled, findings)
        assert values["mu_dynamics"] < 1
        scale[make] = values["parameter_scale"]
    assert not findings
    assert scale[hinf_feedback] > 1.5 * scale[pi_feedback]
    assert math.isfinite(scale[hinf_feedback])


@pytest.mark.parametrize("design", ["pi", "hinf"])
def test_every_key_of_a_linear_controller_goes_with_a_design(design):
    """Case files pass a design all keys of the scheme except the controller that it computes. Here each key has a value."""
    if design == "hinf":
        pytest.importorskip("slycot", reason="requires barbalat[robust]")
    case = """
        name = "c"
        plant = { A_m = [[-1.0]], b = [1.0], theta = [0.5], input = { saturation = [-5, 5] } }
        reference_model = { k_0 = 1.0 }
        reference = { kind = "step", amplitude = 1.0 }
        simulation = { t_end = 1.0, dt = 1e-3 }
        controller = [{ scheme = "linear", design = "DESIGN", unmodelled_delay = 0.02, KEYS }]
    """
    given = {"output": "[1.0]", "nominal": "[0.25]", "anti_windup": "1.5", "name": '"own"'}
    assert {one.name for one in fields(LinearFeedback) if one.init} == {"controller", "unmodelled", *given}
    keys = ", ".join(f"{key} = {value}" for key, value in given.items())
    (made,) = parse_case(case.replace("DESIGN", design).replace("KEYS", keys)).controllers
    assert (made.output, made.nominal, made.anti_windup, made.name) == (1.0, 0.25, 1.5, "own")
