"""The sets derived from ranges of parameters, compared with sampling, least squares by hand and python-control."""

import control
import numpy as np
import pytest

from barbalat import InputError, Plant, Problem, ReferenceModel
from barbalat.plants import Parameter, PhysicalPlant
from barbalat.problem import from_ranges
from barbalat.problem.from_ranges import TIGHTNESS
from barbalat.problem.known_set import ParameterBall, ParameterBox
from barbalat.problem.laurent import products_of
from barbalat.run.results.findings import of_problem
from barbalat.signals import Constant
from independent import refusal

J_eq, B_eq, K_u = 0.00208, 0.0838, 0.1284


def joint(**ranges):
    """The rotary flexible joint with the stiffness and the arm's inertia as parameters."""
    stiffness, inertia = Parameter("K_s", 1.3, **ranges), Parameter("J", 0.0038, between=(0.003, 0.006))
    A = [
        [0, 0, 1, 0],
        [0, 0, 0, 1],
        [0, stiffness / J_eq, -B_eq / J_eq, 0],
        [0, -stiffness / J_eq - stiffness / inertia, B_eq / J_eq, 0],
    ]
    return Plant(A=A, b=[0, 0, K_u / J_eq, -K_u / J_eq], poles=[-8, -20, [-12, 22]], scale=[0.5, 0.2, 4.0, 3.0])


def derived(plant):
    return Problem(plant=plant, reference_model=ReferenceModel(), reference=Constant()).derived


def by_least_squares(plant, A, b):
    """theta and omega with the smallest weighted remainders, and the remainders, by NumPy's least squares."""
    W = 1 / np.asarray(plant.scale if plant.scale is not None else np.ones(plant.n))
    column = (W * plant.b)[:, None]
    theta = np.linalg.lstsq(column, W[:, None] * (A - plant.A_m), rcond=None)[0][0]
    omega = np.linalg.lstsq(column, W * b, rcond=None)[0][0]
    return theta, omega, A - plant.A_m - np.outer(plant.b, theta), b - omega * plant.b


def sampled(plant, count=4000):
    """theta, omega and the two remainders at evenly drawn parameters and at the corners of the ranges."""
    physical, random = plant.physical, np.random.default_rng(5)
    names, ends = list(physical.ranges), np.array(list(physical.ranges.values()))
    corners = np.array(np.meshgrid(*ends)).reshape(len(names), -1).T
    rows = np.vstack([corners, random.uniform(ends[:, 0], ends[:, 1], (count, len(names)))])
    found = [by_least_squares(plant, *physical.matrices(dict(zip(names, row, strict=True)))) for row in rows]
    return [np.array(part) for part in zip(*found, strict=True)]


def pendulum():
    m, length, J, d = (
        Parameter(*one[:2], tolerance=one[2]) for one in (("m", 1.0, 0.5), ("l", 0.5, 0.2), ("J", 0.1, 0.3), ("d", 0.2, 0.5))
    )
    inertia = J + m * length**2
    return Plant(A=[[0, 1], [m * 9.81 * length / inertia, -d / inertia]], b=[0, 1 / inertia], poles=[-3, -4])


def cart():
    """A cart with a pendulum as in data sheets, where every entry has the same uncancelled sum as denominator."""
    M, m, length, d, J = (
        Parameter(*one[:2], tolerance=one[2])
        for one in (("M", 0.5, 0.1), ("m", 0.2, 0.3), ("l", 0.3, 0.2), ("d", 0.1, 0.5), ("J", 0.006, 0.2))
    )
    below = J * (M + m) + M * m * length**2
    A = [
        [0, 1, 0, 0],
        [0, -(J + m * length**2) * d / below, m**2 * 9.81 * length**2 / below, 0],
        [0, 0, 0, 1],
        [0, -m * length * d / below, m * 9.81 * length * (M + m) / below, 0],
    ]
    return Plant(A=A, b=[0, (J + m * length**2) / below, 0, m * length / below], poles=[-3, -4, -5, -6])


def slider():
    """A plant with a common factor, in which m l divides the numerator and the denominator."""
    m, length, r, d = (Parameter(*one, tolerance=0.3) for one in (("m", 0.2), ("l", 0.3), ("r", 0.1), ("d", 0.1)))
    inertia = m * length**2 + m * length * r
    return Plant(A=[[0, 1], [-9.81 * m * length / inertia, -d / inertia]], b=[0, m * length / inertia], poles=[-3, -4])


@pytest.mark.parametrize("plant", [cart(), slider()], ids=["cart", "slider"])
def test_fractions_that_are_not_cancelled_need_no_cuts(plant):
    found = derived(plant)
    assert found.width_ratio <= 1.001 and found.cells == 1


@pytest.mark.parametrize(
    "plant", [joint(tolerance=0.3), pendulum(), cart(), slider()], ids=["joint", "pendulum", "cart", "slider"]
)
def test_the_set_holds_what_sampling_finds_and_is_little_wider(plant):
    found = derived(plant)
    theta, omega, rest_A, rest_b = sampled(plant)
    pairs = [(found.theta.lower, found.theta.upper, theta)]
    if found.input_gain is not None:
        pairs.append((*np.array(found.input_gain).T, omega[:, None]))
    for low, high, seen in pairs:
        width, room = seen.max(axis=0) - seen.min(axis=0), 1e-9 * np.abs(seen).max()
        assert (low <= seen.min(axis=0) + room).all() and (seen.max(axis=0) <= high + room).all()
        assert (high - low <= TIGHTNESS * width + room).all()
    for bound, seen, size in ((found.rest_A, rest_A, 1000.0), (found.rest_b[:, 0], rest_b, 100.0)):
        largest = np.abs(seen).max(axis=0)
        assert (largest <= bound + 1e-9 * size).all()
        assert (bound <= largest + (TIGHTNESS - 1) * (seen.max(axis=0) - seen.min(axis=0)) + 1e-9 * size).all()
    assert found.too_wide is None


def test_bounds_that_remain_too_wide_say_so(monkeypatch):
    """sin(k) cos(k) is at most 1/2, and 1 if the two factors are bounded one by one."""
    monkeypatch.setattr(from_ranges, "MOST_CELLS", 2)
    problem = Problem(
        plant=Plant(
            physical=PhysicalPlant(
                A=[[0, 1], [0, "sin(k)*cos(k)"]], b=[0, 1], parameters=[Parameter("k", 10.0, between=(0.0, 20.0))]
            ),
            poles=[-1, -2],
        ),
        reference_model=ReferenceModel(),
        reference=Constant(),
    )
    found = problem.derived
    assert found.cells == 2 and found.width_ratio == pytest.approx(2, rel=1e-3)
    assert found.sentences[-1].startswith("a bound from the parameters' ranges is 2 times as wide as the values found at points")
    assert [one.sentence for one in of_problem(problem, 1.0) if one.kind == "wide ranges"] == [found.sentences[-1]]


def test_the_nominal_plant_lies_in_its_own_set():
    """The set contains the nominal plant also if an entry is known exactly or a range ends at the nominal value, for any
    roundings."""
    for make in (lambda: joint(tolerance=0.3), pendulum, lambda: joint(between=(1.3, 1.7))):
        for seed in range(10):
            plant = make()
            scale = np.random.default_rng(seed).uniform(0.1, 3.0, plant.n)
            moved = Plant(physical=plant.physical, A_m=plant.A_m, scale=scale)
            problem = Problem(plant=moved, reference_model=ReferenceModel(), reference=Constant())
            assert problem.known.estimate_set.contains(problem.parameters)


def test_formulas_are_written_as_numbers_are():
    """The formulas are in NumPy arrays, have a number to the power of a parameter, and have a sign."""
    k, J = Parameter("k", 3.0, between=[2.0, 4.0]), Parameter("J", 0.5)
    plant = Plant(A=np.array([[0, 1], [-k / J, -(2**k)]]), b=np.array([0, +k]), A_m=[[0, 1], [-2, -3]])
    np.testing.assert_allclose(plant.A_m + np.outer(plant.b, plant.theta), [[0, 1], [-6, -8]], atol=1e-12)
    A, b = plant.physical.matrices({"k": 4.0, "J": 0.5})
    np.testing.assert_allclose(A, [[0, 1], [-8, -16]], rtol=1e-15)
    np.testing.assert_array_equal(b, [0, 4])
    assert "the base of a power" in refusal(lambda: (-2.0) ** k)


def test_parameters_without_ranges_give_a_known_plant():
    """The parameters merely name numbers, so theta and the gain are known. By hand, theta is (-k/J + 12)/(1/J) and
    (-d/J + 7)/(1/J)."""
    plant = PhysicalPlant(A=[[0, 1], ["-k/J", "-0.1"]], b=[0, "1/J"], parameters=[Parameter("k", 1.3), Parameter("J", 0.5)])
    found = derived(Plant(physical=plant, poles=[-3, -4]))
    assert found.theta.lower == pytest.approx([(12 - 2.6) / 2, (7 - 0.1) / 2]) and (found.theta.lower == found.theta.upper).all()
    assert found.is_matched and found.input_gain is None and found.cells == 1


def test_of_the_joint_s_stiffness_change_21_percent_is_unmatched():
    """The change acts along (1/J_eq, -1/J_eq - 1/J) and b along (1, -1). The fraction is the sine of the angle between them."""
    plant = joint(tolerance=0.3)
    found = derived(Plant(physical=plant.physical, A_m=plant.A_m)).shares["K_s"]["A"]
    along, b = np.array([1 / J_eq, -1 / J_eq - 1 / 0.0038]), np.array([1.0, -1.0])
    sine = np.sqrt(1 - (along @ b) ** 2 / (along @ along) / (b @ b))
    assert found == pytest.approx(sine, rel=1e-12) and sine == pytest.approx(0.21, abs=1e-3)


def test_the_pendulum_is_matched_and_its_gain_uncertain():
    """The input's torque acts at the same place as gravity. omega is the nominal J + m l^2 over the actual one, by hand at the
    corners."""
    found = derived(pendulum())
    assert found.is_matched and found.input_gain is not None
    ends = [0.1 * j + 1.0 * m * (0.5 * x) ** 2 for j in (0.7, 1.3) for m in (0.5, 1.5) for x in (0.8, 1.2)]
    assert found.input_gain[0] == pytest.approx((0.35 / max(ends), 0.35 / min(ends)), rel=0.05)


def test_the_nominal_plant_is_python_control_s():
    """The formulas' state space with its output equals a transfer function that is expanded by hand."""
    J, d, k = 0.02, 0.05, 1.3
    plant = PhysicalPlant(
        A=[[0, 1], ["-k/J", "-d/J"]], b=[0, "1/J"], parameters=[Parameter("k", k), Parameter("J", J), Parameter("d", d)]
    )
    A, b = plant.matrices(plant.nominal)
    w = np.geomspace(0.1, 100, 20)
    found = control.ss(A, b[:, None], [[1, 0]], 0)(1j * w)
    np.testing.assert_allclose(found, control.tf([1], [J, d, k])(1j * w), rtol=1e-12)


def test_what_cancels_between_formulas_cancels_before_ranges_are_put_in():
    """With k/J and -k/J along b = (1, -1), theta contains all of the uncertainty, although each entry alone is uncertain by more
    than half of its value."""
    k, J = Parameter("k", 1.0, tolerance=0.5), Parameter("J", 2.0, tolerance=0.5)
    plant = Plant(A=[[k / J, 1], [-k / J, -3]], b=[1, -1], poles=[-1, -2])
    assert derived(plant).is_matched
    assert products_of("k/J - k/J") == {} and products_of("(a + b)*c/c**2") == products_of("a/c + b/c")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Parameter("k", 1.0, between=(2.0, 3.0)), ["parameters.k.between", "contain the value"]),
        (lambda: Parameter("k", 1.0, between=(-1e308, 1e308)), ["parameters.k.between", "width"]),
        (lambda: Parameter("k", 0.0, tolerance=0.5), ["parameters.k.tolerance", "give between"]),
        (lambda: Parameter("k", 1.0, tolerance=1.5), ["parameters.k.tolerance", "below 1"]),
        (lambda: PhysicalPlant(A=[["-K"]], b=[1], parameters=[Parameter("k", 1.0)]), ["plant.A[0][0]", "K", "did you mean 'k'"]),
        (lambda: PhysicalPlant(A=[["1/k"]], b=[1], parameters=[Parameter("k", 0.0)]), ["plant.A[0][0]", "k = 0"]),
        (lambda: derived(Plant(A=[[1 / Parameter("k", 1.0, between=(-1, 2))]], b=[1], poles=[-1])), ["parameters", "bounded"]),
        (lambda: derived(Plant(A=[[1 / Parameter("k", 1.0, between=(0, 2))]], b=[1], poles=[-1])), ["parameters", "bounded"]),
        (lambda: derived(Plant(A=[[1]], b=[Parameter("k", 1.0, between=(-1, 2))], poles=[-1])), ["input gain positive"]),
    ],
)
def test_bad_input_is_one_clear_sentence(make, words):
    with pytest.raises(InputError) as caught:
        make()
    assert all(word in str(caught.value) for word in words), caught.value


@pytest.mark.parametrize("unit", [1e-10, 1.0, 1e10])
def test_an_unmatched_remainder_counts_in_every_unit_of_input_and_state(unit):
    """A remainder that no theta and omega match must not be taken for rounding only because b is small or another entry of A is
    large."""
    g = Parameter("g", 0.0, between=(0.0, 1.0))
    small_b = Plant(A=[[-1, 0.2], [0, -2]], b=[unit * g, unit], A_m=[[-1, 0.2], [0, -2]])
    assert derived(small_b).rest_b[0, 0] == pytest.approx(unit) and not derived(small_b).is_matched
    p = Parameter("p", 3.0, between=(1.0, 3.0))
    large_A = Plant(A=[[-2, 0], [unit, -p]], b=[1, 0], A_m=[[-2, 0], [unit, -3]])
    assert derived(large_A).rest_A[1, 1] == pytest.approx(2.0)
    with pytest.raises(InputError, match="must be matched"):
        Plant(A=[[-2, 0], [unit, -1]], b=[1, 0], A_m=[[-2, 0], [unit, -3]])
    assert derived(Plant(A=[[0, unit], [p / unit, -1]], b=[0, unit], A_m=[[0, unit], [-2 / unit, -3]])).is_matched


def test_the_bound_of_a_small_theta_is_as_tight():
    """If a large b makes theta small, an absolute tolerance once made the interval of theta six times too wide."""
    k, m = (Parameter(name, 2.0, between=(1.0, 10.0)) for name in "km")
    found = [derived(Plant(A=[[0, 1], [-100 * k / (k + m), -3]], b=[0, b], A_m=[[0, 1], [-20, -3]])) for b in (1.0, 1e11)]
    widths = [one.theta.upper[0] - one.theta.lower[0] for one in found]
    assert 1e11 * widths[1] == pytest.approx(widths[0], rel=1e-6)


OWN = PhysicalPlant(
    A=[[0, 1], ["-k/J", "-1/J"]],
    b=[0, "1/J"],
    parameters=[Parameter("J", 1.0, between=(0.5, 2.0)), Parameter("k", 2.0, between=(1.0, 3.0))],
)


def own_set(**given):
    plant = Plant(physical=OWN, poles=[-2, -3])
    return Problem(plant=plant, reference_model=ReferenceModel(k_0=6.0), **given)


def test_a_set_of_the_user_s_own_is_compared_with_the_derived_one():
    """J from 0.5 to 2 times nominal gives omega from 0.5 to 2."""
    whole = own_set().derived
    (gain,), theta = whole.input_gain, whole.theta
    assert gain == pytest.approx((0.5, 2.0), rel=1e-6) and not whole.outside and own_set().derived.used
    wide = ParameterBox(lower=theta.lower - 1.0, upper=theta.upper + 1.0)
    known = own_set(uncertainty=wide).derived
    assert known.outside == f"omega in [{gain[0]:.6g}, {gain[1]:.6g}], but the input gain is assumed to be known"
    assert known.outside in known.sentences[-1] and not known.used
    assert not own_set(uncertainty=wide, input_gain=(0.4, 2.5)).derived.outside
    assert "omega in [0.5, 2], not only in [0.6, 2.5]" in own_set(uncertainty=wide, input_gain=(0.6, 2.5)).derived.outside
    cut = ParameterBox(lower=theta.lower, upper=theta.upper - [0.0, 0.1])
    said = own_set(uncertainty=cut, input_gain=(0.4, 2.5)).derived.outside
    assert said.startswith("theta_2 in [") and "theta_1" not in said
    centre = (theta.lower + theta.upper) / 2
    for radius, fits in ((1.01, True), (0.99, False)):
        ball = ParameterBall(center=centre, radius=radius * float(np.linalg.norm(theta.upper - centre)))
        assert (not own_set(uncertainty=ball, input_gain=(0.4, 2.5)).derived.outside) == fits


def test_an_own_gain_alone_keeps_the_derived_box():
    found = own_set(input_gain=(0.4, 2.5))
    np.testing.assert_array_equal(found.uncertainty.lower, own_set().uncertainty.lower)
    assert found.input_gain == (0.4, 2.5) and not found.derived.outside
    assert "omega in [0.5, 2], not only in" in own_set(input_gain=(0.9, 1.1)).derived.outside


def test_no_share_of_a_change_exceeds_100_percent():
    """With two inputs in nearly the same direction, the projection is oblique, so the remainder of b is larger than its
    change."""
    e = Parameter("e", 0.0, between=(-0.05, 0.05))
    physical = PhysicalPlant(A=[[0, 1], [-2, -3]], b=[[1, 1], ["0.2 + e", 0.1]], parameters=[e])
    plant = Plant(physical=physical, A_m=[[0, 1], [-2, -3]])
    (share,) = (by["b"] for by in plant.from_ranges.shares.values())
    b = np.array([[1, 1], [0.2, 0.1]])
    change = np.array([0, 0.1])
    matched = b[:, 0] * np.linalg.solve(b, change)[0]
    rest = change - matched
    assert np.linalg.norm(rest) > np.linalg.norm(change)
    assert share == pytest.approx(np.linalg.norm(rest) / np.hypot(np.linalg.norm(rest), np.linalg.norm(matched))) and share < 1


def test_an_enclosure_of_what_cancels_exactly_is_called_loose_where_it_is():
    given = [Parameter("a", 2.0, between=(1.5, 2.5)), Parameter("b", 3.0, between=(2.5, 3.5))]
    for text, loose in (("sqrt(a*b) - sqrt(a)*sqrt(b) - 1", True), ("a*b - b*a - 1", False)):
        plant = PhysicalPlant(A=[[text]], b=[1.0], parameters=given)
        found = from_ranges.from_ranges(plant, np.array([[-2.0]]), np.array([1.0]), np.ones(1), "")
        assert found.theta.lower[0] <= 1.0 <= found.theta.upper[0]
        assert (found.too_wide is not None) == loose and (found.width_ratio > 1.05) == loose
