"""Attacks on the known set: random plants with noise at its bound, exact motions and an independent enumeration of vertices."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.linalg import expm

from barbalat import simulate
from barbalat.cases.load import parse_case
from barbalat.identify import known_set
from barbalat.identify.case_text import case_text
from barbalat.identify.identification import identify
from barbalat.identify.known_set import Windows, enclose, least_factor
from barbalat.identify.recording import Recording
from barbalat.identify.windows import windows_of
from barbalat.report import identification as report
from barbalat.validate import InputError


def recorded(rng, A, B, h, N, noise):
    """Exact samples of x' = A x + B u under held steps, with noise at its bound and a slope bound from a fine grid."""
    n, m = len(A), B.shape[1]
    fine = 20
    whole = np.zeros((n + m, n + m))
    whole[:n, :n], whole[:n, n:] = A, B
    step = expm(whole * h / fine)
    x, u, states, slopes = np.zeros(n), np.zeros((N, m)), [], []
    for k in range(N):
        u[k] = rng.choice([-1.0, 1.0], m) if k % 5 == 0 else u[k - 1]
        states.append(x)
        for _ in range(fine):
            slopes.append(np.abs(A @ x + B @ u[k]))
            x = step[:n] @ np.concatenate([x, u[k]])
    x = np.array(states)
    # at the bound, with the worst simple pattern and with a random one
    error = noise * rng.choice([-1.0, 1.0], x.shape)
    outputs, inputs = [f"x{i}" for i in range(n)], [f"u{i}" for i in range(m)]
    bound = 1.1 * np.max(slopes, axis=0) + 1e-9
    return (
        Recording(h * np.arange(N), u, x + error, tuple(inputs), tuple(outputs)),
        dict.fromkeys(outputs, noise), dict(zip(outputs, map(float, bound), strict=True)),
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.short(kept=lambda seed: seed in (0, 2, 6, 11))  # one to three states, one or two inputs
def test_the_true_plant_is_always_in_the_set(seed):
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    A = rng.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + rng.uniform(-0.2, 1.0)) * np.eye(n)  # also slowly unstable
    B = rng.normal(size=(n, m))
    recording, noise, slope = recorded(rng, A, B, 0.02, 300, 10.0 ** rng.uniform(-5, -3))
    for i in range(n):  # the exact set, window by window
        assert windows_of(recording, i, noise, slope).explained_by(np.concatenate([A[i], B[i]])).all()
    found = identify(recording, noise=noise, slope=slope)
    for row, a, b in zip(found.rows, A, B, strict=True):
        truth = np.concatenate([a, b])
        assert (row.enclosure.lower <= truth).all() and (truth <= row.enclosure.upper).all()
        assert (row.enclosure.lower <= row.nominal).all() and (row.nominal <= row.enclosure.upper).all()


@pytest.mark.parametrize("seed", range(6))
def test_the_written_case_can_be_simulated(seed):
    """The plant has one input or two. The step of the case divides its time, and the case has a command for each input."""
    rng = np.random.default_rng(seed)
    n, m = 2 + seed // 4, 1 + seed % 2
    A = rng.normal(size=(n, n)) - 2.0 * np.eye(n)
    recording, noise, slope = recorded(rng, A, rng.normal(size=(n, m)), 0.02, 300, 1e-4)
    case = parse_case(case_text(identify(recording, noise=noise, slope=slope), "data.csv"))
    assert len(case.problem.commands) == m
    assert case.simulation.steps == pytest.approx(case.simulation.t_end / case.simulation.dt)
    short = replace(case.simulation, t_end=20 * case.simulation.dt)
    (result,) = simulate(case.problem, case.controllers, short).values()
    assert np.isfinite(result.e).all()


def test_the_set_is_that_of_enumerated_vertices():
    """With one noisy and one exact regressor, the set is found from every pair of the windows' edges in each half-plane and the
    part that explains all data."""
    rng = np.random.default_rng(3)
    recording, noise, slope = recorded(rng, np.array([[-1.0]]), np.array([[2.0]]), 0.05, 60, 2e-3)
    every = windows_of(recording, 0, noise, slope)
    points = []
    for sign in (-1.0, 1.0):
        rows = np.vstack([-every.Q - sign * every.Q_error, every.Q - sign * every.Q_error, [[-sign, 0.0]]])
        right = np.concatenate([every.left_error - every.left, every.left_error + every.left, [0.0]])
        pairs = np.array(list(combinations(range(len(rows)), 2)))
        pairs = pairs[np.abs(np.linalg.det(rows[pairs])) > 1e-12]
        crossed = np.linalg.solve(rows[pairs], right[pairs][..., None])[..., 0]
        points += list(crossed[(crossed @ rows.T <= right + 1e-9).all(axis=1)])
    found = enclose(every)
    assert found.exact
    assert np.allclose(found.lower, np.min(points, axis=0), rtol=1e-6) and np.allclose(
        found.upper, np.max(points, axis=0), rtol=1e-6
    )
    assert (found.lower <= np.min(points, axis=0)).all() and (np.max(points, axis=0) <= found.upper).all()


def test_the_convex_outer_set_contains_the_orthants(monkeypatch):
    rng = np.random.default_rng(5)
    recording, noise, slope = recorded(rng, np.array([[-1.0, 0.4], [0.3, -2.0]]), np.array([[2.0], [1.0]]), 0.02, 300, 1e-4)
    every = windows_of(recording, 0, noise, slope)
    exact = enclose(every)
    monkeypatch.setattr("barbalat.identify.known_set.MOST_ORTHANTS", 0)
    outer = enclose(every)
    assert exact.exact and not outer.exact
    assert (outer.lower <= exact.lower + 1e-9).all() and (exact.upper <= outer.upper + 1e-9).all()
    assert ((outer.upper - outer.lower) <= 1.5 * (exact.upper - exact.lower)).all()


def test_data_that_nothing_explains_are_refused():
    rng = np.random.default_rng(1)
    recording, noise, _ = recorded(rng, np.array([[-1.0]]), np.array([[2.0]]), 0.05, 100, 1e-3)
    noise["x0"] = 1e-3
    far = recording.outputs.copy()
    far[50:] += 0.05
    with pytest.raises(
        InputError, match="no parameters explain the data within the stated bounds: an equation of x0' explains them only with"
    ):
        identify(replace(recording, outputs=far), noise=noise, slope={"x0": 10.0}, held_out=0.0)


def test_an_unexcited_input_is_a_finding_and_leaves_no_bound():
    rng = np.random.default_rng(2)
    recording, _, slope = recorded(rng, np.array([[-1.0]]), np.array([[2.0, 1.0]]), 0.05, 100, 1e-3)
    silent = recording.inputs.copy()
    silent[:, 1] = silent[:, 0]
    x = Recording(recording.times, silent[:, :1], recording.outputs, ("u0",), ("x0",))
    twice = replace(recording, inputs=np.column_stack([silent[:, 0]] * 2), outputs=_exact(x))
    found = identify(twice, noise={"x0": 1e-3}, slope=slope)
    assert not found.guaranteed
    assert any("do not excite" in said for said in found.findings)
    bounded = identify(twice, noise={"x0": 1e-3}, slope=slope, within={("x0", "u1"): (0.9, 1.1)})
    assert bounded.guaranteed and bounded.rows[0].enclosure.lower[2] >= 0.9


def _exact(x):
    """Exact samples of x' = -x + 3 u."""
    states, now = [], 0.0
    for u in x.inputs[:, 0]:
        states.append(now)
        now = np.exp(-0.05) * now + 3.0 * (1 - np.exp(-0.05)) * u
    return np.array(states)[:, None]


def test_the_fit_finds_the_plant_and_its_interval_holds_it():
    rng = np.random.default_rng(8)
    A, B = np.array([[0.0, 1.0], [-3.0, -1.0]]), np.array([[0.0], [2.0]])
    recording, _, _ = recorded(rng, A, B, 0.01, 2000, 1e-4)
    found = identify(recording)
    assert np.allclose(found.A, A, atol=0.05) and np.allclose(found.B, B, atol=0.05)
    assert min(found.fit.values()) > 0.95
    assert not found.guaranteed and "confidence intervals" in found.findings[-1]


def test_a_slope_that_the_data_contradict_is_refused():
    rng = np.random.default_rng(1)
    recording, noise, _ = recorded(rng, np.array([[-1.0]]), np.array([[2.0]]), 0.05, 100, 1e-3)
    with pytest.raises(InputError, match=r"slope of x0 is 0\.1, but even allowing for their noise the data change by at least"):
        identify(recording, noise=noise, slope={"x0": 0.1})


def test_weak_duality_needs_no_right_multipliers(monkeypatch):
    """With multipliers that are wrong in their sixth digit the bounds still contain the truth."""
    rng = np.random.default_rng(4)
    right = known_set.linprog

    def wrong(*given, **options):
        found = right(*given, **options)
        if found.status == 0:
            found.ineqlin.marginals = found.ineqlin.marginals * (1 + 1e-6 * rng.normal(size=len(found.ineqlin.marginals)))
        return found

    Q = rng.normal(size=(40, 2))
    windows = Windows(Q @ [1.0, -2.0], Q, np.full(40, 0.1), np.full((40, 2), 1e-3))
    exact = enclose(windows)
    monkeypatch.setattr(known_set, "linprog", wrong)
    loose = enclose(windows)
    assert (loose.lower <= exact.lower + 1e-9).all() and (loose.upper >= exact.upper - 1e-9).all()
    assert (loose.upper - loose.lower < 1.1 * (exact.upper - exact.lower)).all()


def test_outputs_that_are_not_the_whole_state_are_a_finding():
    """The output is only the position of an oscillator. With its rate the same recording is predicted without a message."""
    rng = np.random.default_rng(0)
    recording, _, _ = recorded(rng, np.array([[0.0, 1.0], [-400.0, -0.4]]), np.array([[0.0], [30.0]]), 0.01, 800, 1e-5)
    position = replace(recording, outputs=recording.outputs[:, :1], output_names=("x0",))
    assert any("Perhaps the outputs are not the whole state" in one for one in identify(position).findings)
    assert not any("whole state" in one for one in identify(recording, derivatives={"x0": "x1"}).findings)


def test_exact_knowledge_leaves_the_fit_for_the_rest():
    """A coefficient that is known exactly is removed from the regression. A coefficient known to be elsewhere is clipped, and a
    message says so."""
    rng = np.random.default_rng(8)
    A, B = np.array([[0.0, 1.0], [0.0, -1.0]]), np.array([[0.0], [2.0]])
    recording, noise, slope = recorded(rng, A, B, 0.02, 300, 1e-4)
    exact = {("x1", "x0"): (0.0, 0.0)}
    for bounds in ({}, {"noise": noise, "slope": slope}):
        row = identify(recording, derivatives={"x0": "x1"}, within=exact, **bounds).rows[1]
        assert row.nominal[0] == 0.0 and (row.nominal == row.estimate).all()
        assert np.allclose(row.nominal, [0.0, -1.0, 2.0], atol=0.01)
    wide = {
        name: 100 * bound for name, bound in noise.items()
    }  # with this noise a row that is wrong by a few per cent explains the data
    found = identify(recording, derivatives={"x0": "x1"}, within={("x1", "x1"): (-0.98, -0.9)}, noise=wide, slope=slope)
    nominal = found.rows[1].nominal
    assert any("the fit of x1' lies outside the known set" in said for said in found.findings)
    assert nominal[1] == pytest.approx(-0.98, abs=1e-3) and np.allclose(nominal, [0.0, -0.98, 1.97], atol=0.05)


def unstable(h=0.01, N=800, noise=1e-3):
    """A recording of x'' = 25 x + 4 u with a feedback that holds it near 0, a dither, and noise at its bound."""
    rng = np.random.default_rng(3)
    whole = np.array([[0.0, 1.0, 0.0], [25.0, 0.0, 4.0], [0.0, 0.0, 0.0]])
    step, x, u, states = expm(whole * h), np.zeros(2), np.zeros((N, 1)), []
    for k in range(N):
        states.append(x + noise * rng.choice([-1.0, 1.0], 2))
        u[k] = -np.array([10.0, 2.5]) @ states[-1] + 2.0 * rng.choice([-1.0, 1.0])
        x = step[:2] @ [*x, u[k, 0]]
    return Recording(h * np.arange(N), u, np.array(states), ("u",), ("q", "w"))


def test_an_unstable_plant_is_validated_by_predictions_over_its_fastest_growth():
    """By hand, the horizon of 0.2 s is 1 / 5 rad/s, and every prediction starts from a measured state."""
    found = identify(unstable(), derivatives={"q": "w"})
    growth = np.linalg.eigvals(found.A).real.max()
    assert growth == pytest.approx(5.0, rel=0.05)
    assert found.restarted == int(1 / (growth * 0.01)) and found.horizon == pytest.approx(found.restarted * 0.01)
    rest = found.recording.part(found.trained, 800)
    step = expm(np.block([[found.A, found.B], [np.zeros((1, 3))]]) * 0.01)[:2]
    for k in (1, found.restarted, found.restarted + 1, len(rest.times) - 1):
        start = (k - 1) // found.restarted * found.restarted
        x = rest.outputs[start]
        for j in range(start, k):
            x = step @ [*x, rest.inputs[j, 0]]
        np.testing.assert_allclose(found.predicted[k], x, rtol=1e-9)
    assert min(found.fit.values()) > 0.7 and all(found.fit[name] > found.held_fit[name] for name in ("q", "w"))
    assert not any("worse than" in said for said in found.findings)
    told = found.as_json()["held_out"]
    assert told["restart_every"] == found.restarted and told["horizon"] == found.horizon


def test_an_unstable_plant_that_predicts_worse_than_a_held_state_is_a_finding():
    """One recording is a growing oscillation with only one state as output. The other is a growth that has ended before the
    validation samples."""
    t = 0.01 * np.arange(800)
    turned = np.exp(t) * (1 + 2 * np.sin(10 * t))
    ended = np.where(t < 6, np.exp(t), np.exp(6.0) * (1 - 0.05 * (t - 6)))
    for q, worse in ((turned, False), (ended, True)):
        found = identify(Recording(t, unstable().inputs, q[:, None], ("u",), ("q",)))
        assert found.restarted is not None and (found.fit["q"] < found.held_fit["q"]) == worse
        assert (
            any("predicts q worse than holding the state from the last restart does" in said for said in found.findings) == worse
        )
        assert any("The ranges do not describe any real plant" in said for said in found.findings)
        assert "s ahead and fits q" in report.sentence(found) and "restarts from the measured state every" in report.caption(
            found
        )


def test_within_is_honoured_without_noise_bounds():
    recording = unstable()
    free = identify(recording, derivatives={"q": "w"}).rows[1]
    narrow = {("w", "q"): (20.0, 22.0), ("w", "u"): (3.0, 6.0)}
    found = identify(recording, derivatives={"q": "w"}, within=narrow)
    row = found.rows[1]
    assert free.nominal[0] > 22 and row.nominal[0] == pytest.approx(22.0) and (row.estimate == free.estimate).all()
    assert row.ranges[0, 0] >= 20 and row.ranges[0, 1] <= 22 and 3 <= row.ranges[2, 0] <= row.nominal[2] <= row.ranges[2, 1] <= 6
    assert any("the fit of w' lies outside the bounds of `within`" in said for said in found.findings)
    assert "cut to the bounds of `within`, and are not guaranteed" in found.findings[-1]


def test_an_unexcited_coefficient_has_no_interval_and_takes_that_of_within():
    recording = unstable()
    twice = replace(recording, inputs=np.column_stack([recording.inputs] * 2), input_names=("u", "v"))
    row = identify(twice, derivatives={"q": "w"}).rows[1]
    assert np.isinf(row.ranges[2:]).all() and np.isfinite(row.ranges[:2]).all()
    bounded = identify(twice, derivatives={"q": "w"}, within={("w", "u"): (1.0, 3.0), ("w", "v"): (1.0, 3.0)}).rows[1]
    assert np.array_equal(bounded.ranges[2:], [[1.0, 3.0]] * 2)


def test_a_contradiction_of_within_and_the_data_is_said_as_one():
    """The unconstrained row explains the data. The row within the set needs larger bounds, never smaller ones."""
    rng = np.random.default_rng(1)
    recording, noise, slope = recorded(rng, np.array([[-1.0]]), np.array([[2.0]]), 0.05, 100, 1e-3)
    with pytest.raises(InputError) as told:
        identify(recording, noise=noise, slope=slope, within={("x0", "x0"): (-3.0, -2.5)})
    said = str(told.value)
    assert (
        "an equation of x0' whose coefficients are limited by within explains them only if the bounds on noise and slope" in said
    )
    assert "Without within, some other equation explains them" in said
    assert float(said.split("slope are ", maxsplit=1)[1].partition(" times larger")[0]) > 1


def test_the_smallest_factor_is_that_of_a_grid_and_its_bounds_are_explained():
    """With two noisy coefficients no row of a fine grid needs a smaller factor, and one row needs a factor nearly as small."""
    rng = np.random.default_rng(6)
    Q = rng.normal(size=(30, 2))
    windows = Windows(Q @ [0.3, -1.0] + 0.5 * rng.normal(size=30), Q, np.full(30, 0.02), np.full((30, 2), 0.03))
    axis = np.linspace(-2.0, 2.0, 401)
    grid = min(windows.factor(np.array([a, b])) for a in axis for b in axis)
    found = least_factor(windows)
    assert 1.0 < 0.97 * grid < found <= grid
    wider = Windows(windows.left, Q, found * 1.0001 * windows.left_error, found * 1.0001 * windows.Q_error)
    narrower = Windows(windows.left, Q, found * 0.999 * windows.left_error, found * 0.999 * windows.Q_error)
    assert not enclose(wider).empty and enclose(narrower).empty
    half = np.array([[-np.inf, np.inf], [0.5, 2.0]])
    inside = min(windows.factor(np.array([a, b])) for a in axis for b in axis if b >= 0.5)
    assert 0.95 * inside < least_factor(windows, half) <= inside  # a step of the grid changes a ratio by 1.5


def test_data_that_nothing_explains_are_refused_beside_a_regressor_within_its_error():
    """The set is unbounded in its directions and nevertheless empty. This used to be reported as a lack of excitation."""
    rng = np.random.default_rng(0)
    Q = rng.normal(size=(60, 2))
    windows = Windows(5.0 * rng.normal(size=60), Q, np.full(60, 1e-6), np.column_stack([np.full(60, 1e-7), np.full(60, 1e-7)]))
    buried = replace(windows, Q_error=np.column_stack([1.1 * np.abs(Q[:, 0]), np.full(60, 1e-7)]), left=windows.left)
    assert enclose(windows).empty
    silent = replace(buried, left=np.where(np.arange(60) < 30, 0.0, buried.left), Q=Q * [0, 1], Q_error=buried.Q_error * [0, 1])
    assert enclose(silent).empty  # the second regressor alone explains nothing, and the first one does not vary
    assert not np.isfinite(enclose(buried).lower[0])  # a large first coefficient explains every window


def test_a_silent_input_leaves_the_coefficients_of_the_states_bounded():
    """With u = 0 all the time, only the coefficients of u have no bound in the known set and in the intervals."""
    rng = np.random.default_rng(0)
    A = np.array([[0.0, 1.0], [-3.0, -0.8]])
    step, x, states = expm(A * 0.02), np.array([1.0, 0.0]), []
    for _ in range(400):
        states.append(x + 1e-4 * rng.choice([-1.0, 1.0], 2))
        x = step @ x
    rig = Recording(0.02 * np.arange(400), np.zeros((400, 1)), np.array(states), ("u",), ("q", "w"))
    for bounds in ({}, {"noise": dict.fromkeys("qw", 1.01e-4), "slope": {"q": 2.0, "w": 4.0}}):
        found = identify(rig, derivatives={"q": "w"}, **bounds)
        ranges = found.rows[1].ranges
        assert np.isfinite(ranges[:2]).all() and np.isinf(ranges[2]).all()
        assert (ranges[:2, 0] <= A[1]).all() and (A[1] <= ranges[:2, 1]).all()
        assert any("do not excite u in the equation of w'" in said for said in found.findings)
        (_, row) = identify(rig, derivatives={"q": "w"}, within={("w", "u"): (1.5, 2.5)}, **bounds).rows
        assert row.nominal[2] == 2.0 and not row.outside
        np.testing.assert_array_equal(row.ranges[2], [1.5, 2.5])
