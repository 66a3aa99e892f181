from __future__ import annotations

import copy
import pickle
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from scipy import linalg
from scipy.integrate import solve_ivp

from barbalat import Mrac, Simulation, simulate
from barbalat.cases.load import load_case
from barbalat.plants import LqiBaseline
from barbalat.problem.command_gain import commanded, gains_at_rest
from barbalat.problem.labels import Labels
from barbalat.problem.state_feedback import Known, ParameterBox, Plant, Problem, ReferenceModel
from barbalat.signals import Constant, Sine
from barbalat.validate import InputError
from independent import refusal


@pytest.mark.parametrize("n", [1, 2, 3])
def test_P_solves_the_lyapunov_equation(problems, n):
    """P = integral of exp(A_m't) exp(A_m t) gives the same matrix by quadrature over the matrix exponential."""
    A_m = problems[n].plant.A_m
    nodes, weights = np.polynomial.legendre.leggauss(200)
    length = 60.0  # exp(2 * -1 * 60) is below rounding: the slowest pole of the three problems is -1
    times, weights = (nodes + 1) * length / 2, weights * length / 2
    exponentials = linalg.expm(A_m * times[:, None, None])
    expected = sum(w * E.T @ E for w, E in zip(weights, exponentials, strict=True))
    P = problems[n].known.P
    # 1e-10: 200 Gauss nodes resolve the fastest mode exp(-6 t) over 60 s to about that
    np.testing.assert_allclose(P, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())
    assert (P == P.T).all()


def test_P_of_section_v(section_v):
    """By hand, the (2, 2) equation is 2 p_12 - 2 p_22 = -1, the (1, 1) equation is -0.6 p_12 = -1, and the (1, 2) equation gives
    p_11."""
    p_12 = 1 / 0.6
    p_22 = p_12 + 1 / 2
    p_11 = p_12 + 0.3 * p_22
    np.testing.assert_allclose(section_v.known.P, [[p_11, p_12], [p_12, p_22]], rtol=1e-13)


def test_matched_recovers_theta():
    """A = A_m + b theta' for random data."""
    random = np.random.default_rng(1)
    for n in (1, 2, 3, 4):
        A_m = random.normal(size=(n, n)) - 5 * np.eye(n)
        b, theta = random.normal(size=n), random.normal(size=n)
        plant = Plant(A=A_m + np.outer(b, theta), A_m=A_m, b=b)
        np.testing.assert_allclose(plant.theta, theta, atol=1e-13 * 10)  # entries of order 1: a few dozen roundings


def test_matched_with_a_badly_scaled_b():
    plant = Plant(A=[[0, 1], [-1, -1]], A_m=[[0, 1], [-2, -1]], b=[0, 1e-170])  # b'b underflows
    np.testing.assert_allclose(plant.theta, [1e170, 0], rtol=1e-14)


def test_defaults_are_rest_and_a_zero_command():
    problem = Problem(plant=Plant(A_m=[[-1.0]], b=[1.0], theta=[2.0]))
    assert problem.plant.x0.tolist() == [0.0]
    assert problem.reference_model.k_0 == 1
    assert problem.reference(np.array([0.0, 3.0])).tolist() == [0.0, 0.0]


OF_A_BASELINE = {"enters", "theta_0", "nominal"}
"""The gains of the baseline, the command's effect on its states, and theta at the declared values of the parameters."""


def test_a_designer_sees_neither_theta_nor_the_disturbance(section_v):
    assert set(Known.__dataclass_fields__) == {"A_m", "b", "k_0", "x0", "estimate_set", "matched", "saturation"} | OF_A_BASELINE
    simulated = Plant(A=[[0, 1], [2, 3]], b=[0, 1], A_m=[[0, 1], [-4, -3]])  # without parameters this is what is simulated
    assert Problem(plant=simulated).known.nominal is None


def test_signals_in_the_order_of_the_loop(section_v):
    disturbance = Constant(1.0)
    problem = Problem(plant=section_v.plant, reference=section_v.reference, disturbance=disturbance)
    assert problem.signals == (section_v.reference, disturbance)
    assert section_v.signals == (section_v.reference,)


def test_theta_max_is_the_largest_1_norm_on_the_corners():
    box = ParameterBox(lower=[-5.0, 1.0], upper=[3.0, 2.0])
    corners = [abs(a) + abs(b) for a in (-5, 3) for b in (1, 2)]
    assert box.theta_max == max(corners)


def test_the_box_holds_its_faces_and_nothing_beyond():
    box = ParameterBox(lower=[-5.0, -5.0], upper=[5.0, 5.0])
    assert box.contains(np.array([5.0, -5.0]))
    assert not box.contains(np.array([np.nextafter(5, 6), 0.0]))
    assert not box.contains(np.array([0.0, np.nan]))


def test_what_is_given_cannot_be_changed_afterwards(section_v):
    A_m = np.array([[0.0, 1.0], [-0.3, -1.0]])
    plant = Plant(A_m=A_m, b=[0, 1], theta=[4, -3])
    A_m[0, 0] = 7.0
    assert plant.A_m[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        plant.A_m[0, 0] = 7.0
    with pytest.raises(AttributeError):
        plant.theta = np.zeros(2)
    with pytest.raises(AttributeError):
        ReferenceModel(k_0=4.0).k_0 = 5.0
    with pytest.raises(AttributeError):
        section_v.reference = Sine(1.0, 1.0)


@pytest.mark.parametrize(
    "again", [copy.deepcopy, lambda problem: pickle.loads(pickle.dumps(problem))], ids=["deepcopy", "pickle"]
)
@pytest.mark.parametrize("name", ["lateral-aircraft", "l1-output", "wing-rock"])
def test_a_copied_problem_is_as_fixed_as_its_original(name, again):
    """NumPy's copies are writable, and a change would invalidate the validation."""
    problem = load_case(name).problem
    arrays = list(arrays_in(again(problem)))
    assert arrays and not any(array.flags.writeable for array in arrays)
    for array, original in zip(arrays, arrays_in(problem), strict=True):
        np.testing.assert_array_equal(array, original)


def arrays_in(part):
    if isinstance(part, np.ndarray):
        yield part
    elif isinstance(part, (list, tuple)):
        for entry in part:
            yield from arrays_in(entry)
    elif is_dataclass(part):
        for field in fields(part):
            yield from arrays_in(getattr(part, field.name))


def test_a_mask_is_not_ignored():
    theta = np.ma.masked_array([4.0, -3.0], mask=[True, False])
    assert "masked" in refusal(lambda: Plant(A_m=[[0.0, 1.0], [-0.3, -1.0]], b=[0.0, 1.0], theta=theta))
    theta.mask = False
    Plant(A_m=[[0.0, 1.0], [-0.3, -1.0]], b=[0.0, 1.0], theta=theta)


def test_one_command_of_several_inputs_is_a_list_of_one():
    """k_0 has one column, for this command, and the model moves by B k_0 r, as in SciPy's integration."""
    B, k_0 = np.array([[1.0, 0.0], [0.5, 1.0]]), np.array([[2.0], [-3.0]])
    plant = Plant(A_m=[[-2.0, 0.0], [0.0, -3.0]], b=B, theta=[[1.0, 0.5], [0.2, 1.0]], x0=[0.0, 0.0])
    problem = Problem(plant, ReferenceModel(k_0), Sine(1.0, 2.0))
    found = simulate(problem, Mrac(5.0), Simulation(t_end=1.0, dt=1e-3))["MRAC"]
    assert found.r.shape == (len(found.t), 1)
    drive = lambda t, x_m: plant.A_m @ x_m + (B @ k_0)[:, 0] * np.sin(2 * t)  # noqa: E731
    exact = solve_ivp(drive, (0.0, 1.0), [0.0, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(found.x_m[-1], exact, atol=1e-9)


def following(follow, names=(), b=(0.0, 2.0), commands=None):
    labels = Labels(names=names) if names else None
    plant = Plant(A_m=[[0.0, 1.0], [-12.0, -7.0]], b=b, theta=np.zeros(2 * np.ndim(b)))
    model = ReferenceModel(follow=follow)
    return Problem(plant=plant, reference_model=model, labels=labels, reference=commands or Constant(1.0))


def test_the_gain_follows_from_the_state_that_is_to_follow():
    problem = following("angle", names=("angle", "rate"))
    assert problem.k_0 == problem.known.k_0 == pytest.approx(6.0, rel=1e-15)
    assert gains_at_rest(problem)[0, 0] == pytest.approx(1.0, rel=1e-15)
    assert following("x_1").k_0 == problem.k_0
    assert replace(problem, plant=replace(problem.plant, b=[0.0, 3.0])).k_0 == pytest.approx(4.0, rel=1e-15)


def test_the_gains_of_several_inputs_follow_from_as_many_states():
    b, commands = [[1.0, 0.5], [0.0, 2.0]], (Constant(1.0), Constant(2.0))
    problem = following(("x_2", "x_1"), b=b, commands=commands)
    np.testing.assert_allclose(gains_at_rest(problem), [[0.0, 1.0], [1.0, 0.0]], atol=1e-15)
    with pytest.raises(InputError, match=r"^reference must be 2 commands, one for each followed state, got 1"):
        following(("x_2", "x_1"), b=b, commands=commands[:1])
    with pytest.raises(InputError, match=r"must name 2 states, one for each input, got 1"):
        following("x_1", b=b, commands=commands)
    with pytest.raises(InputError, match=r"names x_1, x_1, which come to rest at values that depend on each other"):
        following(("x_1", "x_1"), b=b, commands=commands)


def test_what_cannot_be_followed_is_refused():
    with pytest.raises(InputError, match=r"names rate, which comes to rest at 0 under every constant command"):
        following("rate", names=("angle", "rate"))
    with pytest.raises(InputError, match=r"names no state, got 'x_3'; the states are x_1, x_2"):
        following("x_3")
    with pytest.raises(InputError, match=r"reference_model.k_0 and reference_model.follow are both given"):
        ReferenceModel(k_0=1.0, follow="x_1")
    with pytest.raises(InputError, match=r"reference_model.follow"):
        ReferenceModel(follow=3)


def test_the_state_that_is_declared_to_follow_is_the_commanded_one():
    """Two masses with a spring have the same position in equilibrium, and the second one has to follow."""
    A = [[0.0, 1.0, 0.0, 0.0], [-4.0, -1.0, 4.0, 0.0], [0.0, 0.0, 0.0, 1.0], [4.0, 0.0, -4.0, -1.0]]
    plant = Plant(A=A, b=[0.0, 1.0, 0.0, 0.0], poles=[-1.0, -2.0, -3.0, -4.0])
    followed = Problem(plant=plant, reference_model=ReferenceModel(follow="x_3"))
    np.testing.assert_allclose(gains_at_rest(followed)[[0, 2], 0], 1.0, rtol=1e-9)
    assert commanded(followed) == [(2, [0])]
    assert commanded(Problem(plant=plant, reference_model=ReferenceModel(followed.k_0))) == [(0, [0])]
    around = Plant(A=A, b=[0.0, 1.0, 0.0, 0.0], baseline=LqiBaseline(Q=[1.0] * 5, R=1.0, output=[0.0, 0.0, 1.0, 0.0]))
    assert commanded(Problem(plant=around)) == [(2, [0])]
