"""mu of the matched family, compared with SLICOT's upper bound, feasible parameters and eigenvalues by brute force."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from barbalat import InputError
from barbalat.certificates.linear_loops.ideal import fast_adaptation, known_parameters
from barbalat.linear.robust_stability import MatchedFamily, destabilising, mu_of_family, robust_stability
from barbalat.linear.systems import StateSpace, TransferFunction, input_filter, sensitivity
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.state_feedback import Plant
from independent import refusal


def largest_real_part(family, delta):
    """The largest real part of the closed-loop eigenvalues at theta = centre + width delta, without unmodelled dynamics."""
    S = sensitivity(family.loop)
    moved = S.A.copy()
    moved[:, : len(family.width)] += np.outer(S.B, family.width * delta)
    return np.linalg.eigvals(moved).real.max()


parts = st.floats(-3, 3).map(lambda v: round(v, 3))


@settings(max_examples=200, derandomize=True)
@given(st.lists(st.tuples(parts, parts), min_size=1, max_size=4), st.floats(0.01, 3))
def test_the_exact_value_is_the_least_of_all_upper_bounds(entries, rho):
    """Every slope m = tan(angle) gives an upper bound, which is quasi-convex in the angle. Its minimum is found by a grid and
    then a bounded minimisation."""
    a = np.array([complex(*entry) for entry in entries])

    def bound(angle):
        moved = a.real * np.cos(angle) + a.imag * np.sin(angle)
        return (np.abs(moved).sum() + rho) / np.cos(angle)

    angles = np.linspace(-np.pi / 2, np.pi / 2, 403)[1:-1]
    k = int(np.argmin([bound(angle) for angle in angles]))
    ends = np.concatenate(([1e-6 - np.pi / 2], angles, [np.pi / 2 - 1e-6]))[[k, k + 2]]
    least = minimize_scalar(bound, bounds=ends, method="bounded", options={"xatol": 1e-12})
    value = mu_of_family(a[None], np.array([rho])).value[0]
    assert value <= least.fun * (1 + 1e-9)
    # the search stops within 1e-7 of a kink, on the slope of the two sums and of 1/cos there
    assert value >= least.fun - 1e-7 * (np.abs(a).sum() + rho) / np.cos(least.x) ** 2


def test_slicots_upper_bound_lies_on_it():
    """AB13MD never stops below the exact value. Here its median is 0.1 % and its maximum 8 % above it."""
    slycot = pytest.importorskip("slycot")
    rng, ratios = np.random.default_rng(2), []
    for _ in range(200):
        n = int(rng.integers(1, 5))
        a, rho = rng.normal(size=n) + 1j * rng.normal(size=n), 10 ** rng.uniform(-1, 1)
        value = mu_of_family(a[None], np.array([rho])).value[0]
        bound = slycot.ab13md(np.outer(np.append(a, rho), np.ones(n + 1)), np.ones(n + 1, int), np.array([1] * n + [2]))[0]
        ratios.append(bound / value)
    assert min(ratios) > 1 - 1e-6
    assert np.median(ratios) < 1.01
    assert max(ratios) < 1.2


def test_the_parameters_that_attain_it():
    """A feasible point has that value, so the lower bound equals the upper one."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        a = rng.normal(size=(1, int(rng.integers(2, 5)))) + 1j * rng.normal(size=(1, 1)) * rng.normal(size=1)
        value, m = (float(part[0]) for part in mu_of_family(a, np.zeros(1)))
        delta = destabilising(a[0], m)
        assert np.abs(delta).max() <= 1
        assert delta @ a[0] == pytest.approx(value, abs=1e-9)


def test_known_values():
    one = np.ones((1, 1))
    assert mu_of_family(2 * one, np.zeros(1)).value[0] == 2  # 1 - 2 delta = 0 at delta = 1/2
    assert mu_of_family(2j * one, np.zeros(1)).value[0] == 0  # a real delta never makes 1 - 2j delta zero
    assert mu_of_family(0 * one, np.array([3.0])).value[0] == 3  # complex alone: the modulus
    # 2j delta + 3 z = t real: |z| <= 1 cancels the imaginary part best at delta = 0
    assert mu_of_family(2j * one, np.array([3.0])).value[0] == pytest.approx(3.0, rel=1e-15)
    assert mu_of_family(np.array([[1.0, 1j]]), np.zeros(1)).value[0] == 1


def scalar_family(K: float, width: float, weight=None) -> MatchedFamily:
    """The family x' = -x + theta x + u with u = -K x."""
    return MatchedFamily(
        loop=StateSpace(np.array([[-1.0]]), np.ones(1), np.array([K]), 0.0), width=np.array([width]), weight=weight
    )


def test_a_scalar_plant():
    """The condition -1 - K + theta < 0 is violated by theta = 1 + K, at zero frequency."""
    found = robust_stability(scalar_family(K=3.0, width=2.0))
    assert found.peak == pytest.approx(2 / 4, rel=1e-14)
    assert found.frequency == 0
    assert found.delta == pytest.approx([2.0])
    assert found.scale == pytest.approx(2.0)


def test_a_scalar_plant_with_dynamics():
    """At zero frequency the weight is zero. Above it T = 3/(s + 4), and 3 |W| stays below the effect of the parameter at zero
    frequency."""
    W = TransferFunction([0.1, 0.0], [0.1, 1.0])
    family = scalar_family(K=3.0, width=2.0, weight=W)
    found = robust_stability(family)
    w = np.linspace(0, 50, 20_001)
    a, rho = 2 / (4 + 1j * w), 0.1 * w / np.abs(1 + 0.1j * w) * 3 / np.abs(4 + 1j * w)
    m = np.tan(np.linspace(-1.57, 1.57, 2001))[:, None]
    by_hand = (np.abs(a.real + m * a.imag) + rho * np.sqrt(1 + m**2)).min(axis=0).max()
    assert found.peak == pytest.approx(by_hand, rel=1e-5)  # the grids' spacing
    assert found.delta is None


@pytest.mark.parametrize("kappa", [0.02, 0.05, 0.1, 0.5])
def test_the_section_v_family_by_brute_force(section_v, kappa):
    """No theta of a fine grid inside 1/mu makes the loop unstable, but the reported theta just outside does."""
    centre, width = section_v.uncertainty.middle, section_v.uncertainty.upper
    plant = Plant(A_m=section_v.plant.A_m, b=section_v.plant.b, theta=centre)
    C = input_filter(kappa).realise()
    family = MatchedFamily(loop=fast_adaptation(plant, C), width=width)
    found = robust_stability(family)
    inside = found.scale * (1 - 1e-6)
    corners = np.linspace(-inside, inside, 41)
    assert max(largest_real_part(family, np.array([p, q])) for p in corners for q in corners) < 0
    assert np.abs(found.delta).max() == pytest.approx(found.scale, rel=1e-9)
    assert largest_real_part(family, found.delta * (1 + 1e-6)) > 0
    # the family's eigenvalues are the eigenvalues of the loop with that theta
    moved = Plant(A_m=plant.A_m, b=plant.b, theta=centre + width * found.delta)
    loop = fast_adaptation(moved, C)
    eigenvalues = np.linalg.eigvals(loop.A - np.outer(loop.B, loop.C) / (1 + loop.D))
    assert abs(eigenvalues.real.max()) < 1e-6


def test_third_order_box_by_random_search(third_order):
    centre, width = third_order.uncertainty.middle, third_order.uncertainty.upper
    p = third_order.plant
    loop = known_parameters(Plant(A_m=p.A_m, b=p.b, theta=centre), np.array([2.0, 1.0, 1.0]))
    family = MatchedFamily(loop=loop, width=width)
    found = robust_stability(family)
    rng = np.random.default_rng(7)
    for _ in range(5000):  # the corners of a random face: real parts are largest there (edges of a polytope)
        delta = rng.choice([-1.0, 1.0], 3) * np.where(rng.random(3) < 0.3, rng.random(3), 1.0)
        assert largest_real_part(family, delta * found.scale * (1 - 1e-6)) < 0
    assert largest_real_part(family, found.delta * (1 + 1e-6)) > 0


def test_a_single_uncertain_parameter_acts_only_where_its_response_is_real(section_v):
    """With theta_1 uncertain and theta_2 known, a grid alone would miss the isolated frequencies."""
    p = section_v.plant
    plant = Plant(A_m=p.A_m, b=p.b, theta=[0.0, 0.0])
    C = input_filter(0.3).realise()
    for width in ([5.0, 0.0], [0.0, 5.0]):
        family = MatchedFamily(loop=fast_adaptation(plant, C), width=np.array(width))
        found = robust_stability(family)
        deltas = np.linspace(-3 * found.scale, 3 * found.scale, 60_001)[:, None] * np.sign(width)
        unstable = [np.abs(d).max() for d in deltas if largest_real_part(family, d) > 0]
        assert min(unstable) == pytest.approx(found.scale, rel=2e-4)  # the grid of deltas


def test_an_unstable_centre_is_refused():
    box = ParameterBox(lower=[0.0], upper=[8.0])
    centre, width = box.middle, box.upper - box.middle
    loop = known_parameters(Plant(A_m=[[-1.0]], b=[1.0], theta=centre), np.array([2.0]))
    assert "centre" in refusal(lambda: MatchedFamily(loop=loop, width=width))
    with pytest.raises(InputError):
        MatchedFamily(loop=loop, width=width)
