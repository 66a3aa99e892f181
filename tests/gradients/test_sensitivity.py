"""Derivatives of metrics are compared with closed forms and with differences of the same runs, and are rejected where they do not
exist."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm_frechet
from scipy.optimize import brentq

from barbalat import InputError, load_case, simulate
from barbalat.cases.load import CaseText
from barbalat.gradients.neighbourhood import NO_SLOPE, Neighbourhood, NoSlope
from barbalat.gradients.sensitivity import sensitivity
from barbalat.open_numbers.varied import VariedCase
from case_texts import DRIVE, SECTION_V
from independent import refusal

LINEAR = """
name = "linear"
[plant]
A_m = [[-2.0]]
b = [1.5]
theta = [{theta}]
x0 = [0.3]
[reference_model]
k_0 = 1.2
[reference]
kind = "constant"
value = 1.0
[uncertainty]
lower = [-3.0]
upper = [3.0]
[simulation]
t_end = 1.0
dt = 1e-3
[[controller]]
name = "linear"
scheme = "linear"
nominal = [0.4]
output = [1.0]
controller = {{ num = [0.5], den = [1.0] }}
"""


def written(tmp_path, text):
    path = tmp_path / "case.toml"
    path.write_text(text)
    return path


def closed_form(theta: float, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """e, its derivative in theta, and u, from the matrix exponential of z' = M z, z = (x, x_m, 1)."""
    M = np.array([[-2.0 + 1.5 * (theta - 0.4 - 0.5), 1.5 * 0.5, 1.5 * 1.2], [0.0, -2.0, 1.5 * 1.2], [0.0, 0.0, 0.0]])
    by_theta, z0 = np.diag([1.5, 0.0, 0.0]), np.array([0.3, 0.3, 1.0])
    pairs = [expm_frechet(M * one, by_theta * one) for one in t]
    z, slope = (np.array([pair[k] @ z0 for pair in pairs]) for k in (0, 1))
    return z[:, 0] - z[:, 1], slope[:, 0], 1.2 - 0.4 * z[:, 0] + 0.5 * (z[:, 1] - z[:, 0])


def test_a_linear_loop_has_the_derivatives_of_its_closed_form(tmp_path):
    found = sensitivity(
        written(tmp_path, LINEAR.format(theta=1.0)), to=["plant.theta[0]"], of=["max_abs_e", "rms_e", "max_abs_u"]
    )
    t = np.arange(1001) * 1e-3
    e, slope, u = closed_form(1.0, t)
    name = found.controllers[0]
    largest = found.of(name, "max_abs_e[0]")["plant.theta[0]"]
    assert largest.instant == pytest.approx(1.0)
    assert largest.derivative == pytest.approx(slope[-1], rel=1e-9)  # RK4's error
    assert largest.elasticity == pytest.approx(slope[-1] / e[-1], rel=1e-9)
    rms = found.of(name, "rms_e[0]")["plant.theta[0]"]
    assert rms.derivative == pytest.approx((e @ slope) / np.sqrt(1001 * (e @ e)), rel=1e-9)
    demand = found.of(name, "max_abs_u")["plant.theta[0]"]
    assert u.argmax() == 0 and demand.instant == 0.0 and demand.derivative == 0.0


def test_a_figure_at_a_corner_is_refused_with_both_slopes(tmp_path):
    """At this theta the control is as large, with the other sign, at the end as at the start, where it does not move."""
    theta = brentq(lambda one: closed_form(one, np.array([1.0]))[2][0] + 1.08, 1.0, 4.0, xtol=1e-14)
    text = LINEAR.format(theta=theta).replace("upper = [3.0]", "upper = [9.0]")
    (one,) = sensitivity(written(tmp_path, text), to=["plant.theta[0]"], of=["max_abs_u"]).derivatives
    slope = 0.9 * closed_form(theta, np.array([1.0]))[1][0]  # of -u
    assert one.derivative is None and one.elasticity is None
    assert one.refused is not None and one.refused.startswith("it has a corner here: its slope is ")
    assert f"{slope:.3g} above, as the extremum passes between t = 0 s and t = 1 s" in one.refused
    assert one.difference == pytest.approx(slope / 2, rel=1e-3)


def test_a_derivative_that_does_not_describe_changes_of_a_thousandth_is_marked(tmp_path):
    """The estimates of L1 with a high gain turn so fast that their final value is far from linear over a thousandth."""
    path = written(tmp_path, SHORT + controller("l1"))
    found = sensitivity(path, to=["reference.amplitude"], of=["theta_hat_final", "rms_e"]).derivatives
    for one in found:
        wide, _, narrow = one.differences
        assert one.derivative == pytest.approx(narrow, rel=1e-2)
        assert one.local == (abs(wide - narrow) > 0.1 * abs(narrow)) == one.figure.startswith("theta_hat_final")


def test_an_error_that_is_zero_has_a_corner(tmp_path):
    """Without uncertainty MRAC follows its model exactly, and either sign of theta makes an error."""
    text = SHORT.replace("theta = [4.0, -3.0]", "theta = [0.0, 0.0]") + controller("mrac")
    found = sensitivity(written(tmp_path, text), to=["plant.theta[0]", "reference.amplitude"], of=["rms_e", "max_abs_e"])
    for one in found.derivatives:
        if str(one.path) == "plant.theta[0]":
            assert one.at == 0.0 and one.refused is not None and one.refused.startswith("it has a corner here")
        else:
            assert one.derivative == 0.0 and one.elasticity is None


SHORT = 'name = "short"' + SECTION_V + "[simulation]\nt_end = 2.0\ndt = 5e-4\n"
SCHEMES = {
    "mrac": "gamma = 3.0",
    "active projection": "gamma = 0.3\ntheta_hat0 = [4.9, -2.0]",
    "l1": "gamma = 100.0\nfilter = { kappa = 0.02 }",
    "robust-mrac": 'c_0 = [1.0, 1.0]\ntau = 0.5\nlaw = { kind = "least-squares", covariance0 = 50.0 }',
    "mrac-normalized": 'c_0 = [1.0, 1.0]\nlaw = { kind = "gradient", gamma = 10.0 }',
    "adrc": "bandwidth = 20.0",
    "sampled": "gamma = 100.0\nfilter = { kappa = 0.05 }\nsample_time = 5e-3",
}
OWN = {"mrac": "gamma", "l1": "filter.kappa", "robust-mrac": "tau", "mrac-normalized": "law.gamma", "adrc": "bandwidth"}
"""A number of a controller, which its run depends on."""


def controller(name: str) -> str:
    scheme = {"active projection": "mrac", "sampled": "l1"}.get(name, name)
    return f'[[controller]]\nname = "{name}"\nscheme = "{scheme}"\n{SCHEMES[name]}\n'


PATHS = ("plant.theta[0]", "plant.theta[1]", "plant.x0[0]", "reference_model.k_0", "reference.amplitude", "reference.frequency")


def confirmed(path, to, of=("max_abs_e", "rms_e", "tail_max_abs_e", "max_abs_u", "theta_hat_final"), refused=0):
    """The derivatives, of which all but this number are confirmed by differences, most of them closely."""
    found = sensitivity(path, to=to, of=of)
    accepted = [one for one in found.derivatives if one.derivative is not None]
    assert len(found.derivatives) - len(accepted) <= refused, [
        (one.figure, str(one.path), one.refused) for one in found.derivatives
    ]
    for one in accepted:
        assert one.difference == pytest.approx(one.derivative, rel=2e-2, abs=3e-6 * abs(one.at) / (abs(one.value) or 1.0))
    assert any(one.derivative for one in accepted)
    return found


@pytest.mark.parametrize("name", SCHEMES)
def test_each_scheme_has_the_derivatives_of_its_differences(name, tmp_path):
    own = [f"controller[0].{OWN[name]}"] if name in OWN else []
    of = ("max_abs_e", "rms_e", "tail_max_abs_e", "max_abs_u", *(("theta_hat_final",) if name != "adrc" else ()))
    found = confirmed(written(tmp_path, SHORT + controller(name)), [*PATHS, *own], of)
    assert not own or any(str(one.path) == own[0] and one.derivative for one in found.derivatives)


LIMITED = SHORT.replace("amplitude = 50.0", "amplitude = 2.0").replace("x0 = [1.0, 1.0]", "x0 = [1.0, 1.0]\ninput = {{ {} }}")


@pytest.mark.parametrize(
    "limits",
    [
        "saturation = [-6, 6]",
        "rate_limit = 30.0",
        "delay = 0.01025",
        "delay = 0.01025, saturation = [-6, 6]",
        "actuator = { num = [2500], den = [1, 100, 2500] }",
    ],
)
def test_limits_and_delays_have_them_too(limits, tmp_path):
    text = LIMITED.format(limits) + controller("mrac") + controller("sampled")
    of_the_delay = ["plant.input.delay"] if "delay" in limits else []
    found = confirmed(
        written(tmp_path, text), ["plant.theta[0]", "reference.amplitude", *of_the_delay], of=["rms_e", "max_abs_e"]
    )
    assert not found.without


def test_measurement_noise_stays_the_same(tmp_path):
    noisy = SHORT.replace(
        "[reference_model]", "[sensor]\nnoise = { std = 0.01, sample_time = 0.01, seed = 3 }\n[reference_model]"
    )
    text = noisy + controller("mrac")
    confirmed(written(tmp_path, text), ["plant.theta[0]", "sensor.noise.std"], of=["rms_e"])


def test_output_feedback(tmp_path):
    own = CaseText.read("rohrs").text.replace("t_end = 80.0", "t_end = 2.0").replace("t_end = 40.0", "t_end = 2.0")
    path = written(tmp_path, own)
    found = sensitivity(path, to=["plant.transfer_function.num[0]", "reference.constant"], of=["rms_e", "max_abs_y"])
    assert all(one.derivative is not None for one in found.derivatives)


def test_values_are_those_of_the_run_and_do_not_depend_on_threads():
    case = load_case("first-order")
    case = replace(case, simulation=replace(case.simulation, t_end=2.0))
    one = sensitivity(case, to=["plant.theta[0]", "controller[0].gamma"], threads=1)
    other = sensitivity(case, to=["plant.theta[0]", "controller[0].gamma"], threads=2)
    assert one.derivatives == other.derivatives
    results = simulate(case.problem, case.controllers, case.simulation)
    for name, result in results.items():
        found = one.of(name, "rms_e[0]")["plant.theta[0]"]
        assert found.at == pytest.approx(result.metrics.rms_e[0, 0], rel=1e-12)  # other numbers are compiled in


def test_a_controllers_figures_depend_on_no_other_controller(tmp_path):
    text = SHORT + controller("mrac") + controller("l1")
    found = sensitivity(written(tmp_path, text), of=["rms_e"])
    first = {str(one.path) for one in found.derivatives if one.controller == found.controllers[0]}
    assert "controller[0].gamma" in first and "controller[1].gamma" not in first
    own = [one for one in found.derivatives if one.figure == "rms_e[0]" and one.controller == found.controllers[0]]
    elasticities = [abs(one.elasticity) for one in own if not one.definition]
    assert elasticities == sorted(elasticities, reverse=True)


def test_numbers_without_derivatives_are_named_with_the_reason(tmp_path):
    text = LIMITED.format("delay = 0.01").replace(
        'kind = "sine"\namplitude = 2.0\nfrequency = 0.5', 'kind = "step"\namplitude = 5.0\nstart = 0.5'
    )
    path = written(tmp_path, text + controller("mrac"))
    to = ["plant.theta[0]", "plant.input.delay", "reference.start", "uncertainty.lower[0]"]
    found = sensitivity(path, to=to, of=["rms_e"])
    assert {one: why.split(":")[0] for one, why in found.without.items()} == {
        "plant.input.delay": "the delay crosses a multiple of simulation.dt = 0.0005 s, where its interpolation has a corner",
        "reference.start": "it moves the instants at which a signal jumps or bends, and a jump has no tangent",
    }
    assert found.as_json()["without"] == found.without


def test_a_diverging_run_has_no_derivatives(tmp_path):
    text = LINEAR.format(theta=2.9).replace("t_end = 1.0", "t_end = 100.0").replace("nominal = [0.4]", "nominal = [-2.0]")
    (one,) = sensitivity(written(tmp_path, text), to=["plant.theta[0]"], of=["max_abs_u"]).derivatives
    assert one.at is None and one.derivative is None and one.refused == "the run, or a run near this value, diverges"


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (
            {"of": ["verdict"]},
            "verdict is not a metric of a run that has a derivative: a verdict or an instant has no derivative",
        ),
        ({"of": ["max_e"]}, "max_e is not a metric of a run that has a derivative; those that have one are max_abs_e"),
        ({"to": ["plant.tehta[0]"]}, "the case does not give plant.tehta[0]; did you mean 'plant.theta[0]'?"),
        ({"to": ["plant.theta"]}, "plant.theta is not a single number; name one of plant.theta[0]"),
        ({"to": ["nonsense"]}, "the case does not give nonsense; its numbers are in plant, reference_model, reference, "),
        ({"to": ["controller[0].name"]}, "the case does not give controller[0].name"),
        ({"to": ["plant.nonsense"]}, "the case does not give plant.nonsense: write it into the case first"),
        ({"controllers": ["L2"]}, "there is no controller 'L2'"),
    ],
)
def test_wrong_names_are_refused(wrong, said):
    assert refusal(lambda: sensitivity("first-order", **wrong)).startswith(said)


def test_with_a_tolerance_the_derivatives_are_those_of_fixed_steps_that_agree_with_it(tmp_path):
    """The reference is given by differences of runs at a tolerance so small that their steps do not matter."""
    path = written(tmp_path, DRIVE)
    found = sensitivity(path, to=["plant.theta[0]", "controller[0].gamma"], of=["max_abs_e", "rms_e"])
    assert found.steps is not None and found.steps.startswith("all runs here use fixed steps, rk4 with h = ")
    assert found.as_json()["steps"] == found.steps
    assert sensitivity(load_case(path), to=["plant.theta[0]"], of=["rms_e"]).steps == found.steps
    text = CaseText(DRIVE.replace("tolerance = 1e-6", "tolerance = 1e-11"))
    for one in found.derivatives:
        cases = [VariedCase(text, (one.path,)).at([one.value + step]) for step in (1e-3, -1e-3)]
        above, below = (
            simulate(case.problem, case.controllers, case.simulation)["MRAC"].metrics.columns()[one.figure][0] for case in cases
        )
        assert one.derivative == pytest.approx((above - below) / 2e-3, rel=1e-3)  # RK4's error, and the difference's of 1e-6


def test_no_steps_are_sought_for_samples_that_jitter(tmp_path):
    jittering = DRIVE.replace("[[controller]]", '[[faults]]\nkind = "jitter"\ntime = 1e-3\n[[controller]]')
    jittering = jittering.replace('scheme = "mrac"', 'scheme = "mrac"\nsample_time = 0.01')
    with pytest.raises(InputError, match="none can be found for samples with jitter"):
        sensitivity(written(tmp_path, jittering))


DEFINING = """
name = "chain"
[plant]
A = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, -2.0, -1.0]]
b = [0.0, 0.0, 1.0]
x0 = [0.1, 0.2, 0.0]
[plant.input]
actuator = { num = [20.0], den = [1.0, 20.0] }
multiplicative = { num = [0.1], den = [0.05, 1.0] }
[reference_model]
poles = [-2.0, -3.0, -4.0]
k_0 = 24.0
[reference]
kind = "sine"
amplitude = 1.0
frequency = 1.0
[simulation]
t_end = 1.0
dt = 1e-3
[[controller]]
scheme = "mrac"
gamma = 1.0
"""


def test_numbers_that_define_a_form_are_marked_and_come_last(tmp_path):
    """The marked numbers are those of a chain of integrators, a denominator's 1, and the coefficients of an actuator whose static
    gain is one."""
    found = [one for one in sensitivity(written(tmp_path, DEFINING), of=["rms_e"]).derivatives if one.figure == "rms_e[0]"]
    actuator, multiplicative = "plant.input.actuator", "plant.input.multiplicative"
    assert {str(one.path) for one in found if one.definition} == {
        "plant.A[0][1]", "plant.A[1][2]", f"{actuator}.num[0]", f"{actuator}.den[0]", f"{actuator}.den[1]",
        f"{multiplicative}.den[1]",
    }  # fmt: skip
    marks = [one.definition for one in found]
    assert marks == sorted(marks)


RANGED = f"[parameters]\nK = {{ value = 1.3, tolerance = 0.2 }}\n{DEFINING[DEFINING.index('[plant]') :]}"
for old, new in (
    ("A = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, -2.0, -1.0]]", 'A = [[0.0, 1.0], ["-K", -1.0]]'),
    ("b = [0.0, 0.0, 1.0]", "b = [0.0, 1.0]"),
    ("x0 = [0.1, 0.2, 0.0]\n", ""),
    ("poles = [-2.0, -3.0, -4.0]", "poles = [-2.0, -3.0]"),
    ("k_0 = 24.0", "k_0 = 6.0"),
):
    assert old in RANGED
    RANGED = RANGED.replace(old, new)


@pytest.mark.parametrize("t_end", [1.5, 2.0, 10.0])
def test_a_signal_is_moved_although_the_known_set_is_rounded_anew(t_end, tmp_path):
    """The scale of the states, with which theta is computed from A, follows from the motion of the command."""
    path = written(tmp_path, 'name = "ranged"\n' + RANGED.replace("t_end = 1.0", f"t_end = {t_end}"))
    found = sensitivity(path, to=["reference.amplitude"], of=["rms_e"])
    assert not found.without and all(one.derivative for one in found.derivatives)


def test_numbers_that_another_one_moves_by_rounding_alone_have_no_slope_in_it(tmp_path):
    """Theta's last digits follow from k_0, by the scale of the states."""
    truth = "[truth]\nA = [[0.0, 1.0], [-1.4, -1.0]]\nb = [0.0, 0.9]\n[reference_model]"
    path = written(tmp_path, 'name = "ranged"\n' + RANGED.replace("[reference_model]", truth))
    found = sensitivity(path, of=["rms_e"])
    assert {"reference_model.k_0", "truth.A[1][0]"} <= {str(one.path) for one in found.derivatives if one.derivative}
    assert {str(one.path) for one in found.derivatives if one.definition} >= {"truth.A[0][1]"}


def test_a_number_without_a_slope_leaves_the_others(tmp_path, monkeypatch):
    """The test pretends that the numbers that follow from k_0 have a corner."""

    def directions(near, *arguments):
        for one in near.moved:
            if str(one.path) == "reference_model.k_0":
                raise NoSlope(one.path)
        return own(near, *arguments)

    own = Neighbourhood.directions
    monkeypatch.setattr(Neighbourhood, "directions", directions)
    path = written(tmp_path, LINEAR.format(theta=1.0))
    found = sensitivity(path, to=["reference_model.k_0", "plant.theta[0]"], of=["rms_e"])
    assert found.without == {"reference_model.k_0": NO_SLOPE}
    assert [str(one.path) for one in found.derivatives] == ["plant.theta[0]"]
    assert refusal(lambda: sensitivity(path, to=["reference_model.k_0"])).endswith(f"reference_model.k_0: {NO_SLOPE}")
