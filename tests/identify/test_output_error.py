"""The confidence intervals by Monte Carlo, offsets, dead times, and findings about fits that do not describe any plant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from barbalat.identify.identification import identify
from barbalat.identify.recording import Recording
from barbalat.validate import InputError

PLANT = np.array([[0.0, 1.0, 0.0], [-3.0, -0.8, 2.0]])
"""The plant x'' = -3 x - 0.8 x' + 2 u with a period of 3.6 s."""


def rig(h, noise, seed, N=400, plant=PLANT, feedback=None):
    """Exact samples of q and w under held inputs, open loop or under u = -feedback y + dither, with uniform noise."""
    rng = np.random.default_rng(seed)
    step, x, u, inputs, outputs = expm(np.vstack([plant, np.zeros(3)]) * h), np.zeros(2), 0.0, [], []
    for k in range(N):
        y = x + noise * rng.uniform(-1, 1, 2)
        if feedback is not None:
            u = -feedback @ y + 2.0 * rng.choice([-1.0, 1.0])
        elif k % max(1, round(0.8 / h)) == 0:
            u = rng.uniform(-2, 2)
        inputs.append([u])
        outputs.append(y)
        x = step[:2] @ [*x, u]
    return Recording(h * np.arange(N), np.array(inputs), np.array(outputs), ("u",), ("q", "w"))


def hits(found, plant):
    return sum(
        int(((row.interval[:, 0] <= a) & (a <= row.interval[:, 1])).sum()) for row, a in zip(found.rows, plant, strict=True)
    )


@pytest.mark.parametrize("h", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("noise", [1e-4, 1e-2])
def test_95_of_100_intervals_hold_the_truth(h, noise):
    """At least 162 of 180 intervals contain the truth. With a standard deviation of 2.9 for independent intervals, about 171
    usually do."""
    found = [identify(rig(h, noise, seed)) for seed in range(30)]
    assert 162 <= sum(hits(one, PLANT) for one in found) <= 179
    assert all(one.converged for one in found)
    for one in found[:3]:  # the only message is that they are no guarantee
        assert [said for said in one.findings if "no noise bound" not in said] == []


def test_the_intervals_shrink_with_the_noise():
    """Twice the noise gives twice the interval. The trapezoidal rule's error at this sample time would be 1 %."""
    widths = [np.ptp(identify(rig(0.2, noise, 3)).rows[1].interval, axis=1) for noise in (1e-4, 2e-4)]
    np.testing.assert_allclose(widths[1], 2 * widths[0], rtol=1e-2)
    assert (widths[0] < 1e-3).all()


def test_an_unstable_plant_under_feedback_has_intervals_that_hold_it():
    """Measurement noise enters the input, so any regression on the measured states would be biased."""
    plant = np.array([[0.0, 1.0, 0.0], [25.0, 0.0, 4.0]])
    known = {("q", "q"): (0.0, 0.0), ("q", "w"): (1.0, 1.0), ("q", "u"): (0.0, 0.0)}
    found = [identify(rig(0.01, 1e-3, seed, 800, plant, np.array([10.0, 2.5])), within=known) for seed in range(20)]
    assert sum(hits(one, plant) for one in found) - 3 * len(found) >= 51  # of 60
    assert all(one.horizon == pytest.approx(0.2, rel=0.1) for one in found)


def test_uneven_samples_need_no_sample_time():
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.05, 0.15, 200))
    x, outputs, u = np.zeros(2), [], np.repeat(rng.uniform(-2, 2, 25), 8)
    for h, v in zip(np.diff(t, append=t[-1] + 0.1), u, strict=True):
        outputs.append(x)
        x = (expm(np.vstack([PLANT, np.zeros(3)]) * h) @ [*x, v])[:2]
    found = identify(Recording(t, u[:, None], np.array(outputs), ("u",), ("q", "w")))
    np.testing.assert_allclose(np.column_stack([found.A, found.B]), PLANT, atol=1e-6)
    with pytest.raises(InputError, match="delay needs samples at equal intervals"):
        identify(found.recording, delay=0.1)


THERMAL = np.array([-0.0067, 0.004])


def furnace(delay=0.0, ambient=0.0, h=2.0, N=900, noise=0.05, seed=0):
    """T' = -0.0067 (T - ambient) + 0.004 u(t - delay) from equilibrium. The heater is at 0 before the recording."""
    rng = np.random.default_rng(seed)
    d, T, u, temperature = round(delay / h), 0.0, np.repeat(rng.uniform(0, 100, N // 60 + 1), 60)[:N], []
    grown = np.exp(THERMAL[0] * h)
    for k in range(N):
        temperature.append([ambient + T + noise * rng.uniform(-1, 1)])
        T = grown * T + (grown - 1) / THERMAL[0] * THERMAL[1] * (u[k - d] if k >= d else 0.0)
    return Recording(h * np.arange(N), u[:, None], np.array(temperature), ("u",), ("T",))


@pytest.mark.parametrize(
    ("delay", "ambient", "tried"),
    [(20.0, 0.0, "--delay 20"), (0.0, 21.0, "--offset"), (20.0, 21.0, "--offset --delay 20")],
)
def test_a_dead_time_and_absolute_values_are_found_and_told(delay, ambient, tried):
    recording = furnace(delay, ambient)
    wrong = identify(recording)
    assert any(said.endswith(f"try {tried}") for said in wrong.findings)
    assert any("are not noise: the correlation" in said for said in wrong.findings)
    assert hits(wrong, [THERMAL]) == 0
    right = identify(recording, offset=ambient != 0, delay=delay)
    assert right.other is None and [said for said in right.findings if "no noise bound" not in said] == []
    assert right.fit["T"] > 0.98
    low, high = right.rows[0].interval[:2].T
    assert (low <= THERMAL).all() and (high >= THERMAL).all()
    assert wrong.other.fit == pytest.approx(right.fit["T"], abs=5e-3)


def test_the_operating_point_is_an_equilibrium_that_is_removed():
    found = identify(furnace(0.0, 21.0), offset=True, noise={"T": 0.0501}, slope={"T": 0.5})
    point = found.operating_point
    assert point["T"] - 21.0 == pytest.approx(THERMAL[1] / -THERMAL[0] * point["u"], rel=2e-3)
    assert found.coefficient_names == ("T", "u", "constant")
    low, high = found.rows[0].ranges[:2].T  # of every plant that explains the data with some constant
    assert found.guaranteed and (low <= THERMAL).all() and (high >= THERMAL).all()
    start = found.trained
    assert np.abs(found.recording.outputs[start:] - found.predicted).max() < 1.0  # in absolute values


def test_a_plant_without_an_equilibrium_has_no_operating_point():
    """The plant is x' = 1 plus a drift without noise, for any u."""
    t = 0.1 * np.arange(200)
    x = np.column_stack([t, np.sin(t)])
    u = np.cos(t)[:, None]
    known = {("x", "x"): (0.0, 0.0), ("x", "s"): (0.0, 0.0), ("x", "u"): (0.0, 0.0)}
    found = identify(Recording(t, u, x, ("u",), ("x", "s")), offset=True, within=known)
    assert found.operating_point is None
    assert found.rows[0].nominal[-1] == pytest.approx(1.0)


def test_dead_times_must_be_multiples_and_shorter_than_the_recording():
    with pytest.raises(InputError, match=r"delay must be a multiple of the sample time, such as 2 or 4, got 3"):
        identify(furnace(), delay=3.0)
    with pytest.raises(InputError, match="delay is 1798, but the recording lasts only 1798 s"):
        identify(furnace(), delay=1798.0)
    recording = furnace()
    with pytest.raises(InputError, match="no column may have the name 'constant'"):
        identify(replace(recording, output_names=("constant",)), offset=True)


def test_infeasible_data_are_refused_with_the_factor_and_what_to_try():
    with pytest.raises(InputError) as told:
        identify(furnace(20.0, 21.0), noise={"T": 0.0501}, slope={"T": 0.5})
    assert str(told.value).startswith(
        "no parameters explain the data within the stated bounds: an equation of T' explains them only"
    )
    assert str(told.value).endswith("try --offset --delay 20")
    factor = float(str(told.value).split("slope that are ")[1].split(" ")[0])
    wide = {"noise": {"T": 0.0501 * factor * 1.01}, "slope": {"T": 0.5 * factor * 1.01}}
    assert identify(furnace(20.0, 21.0), **wide).rows[0].enclosure is not None


def test_a_nonlinear_plant_describes_no_plant():
    """x' = -x^3 + u far beyond its linear range has meaningless intervals, and a message says so."""
    rng, x, outputs, u = np.random.default_rng(0), 0.0, [], np.repeat(np.random.default_rng(0).choice([-0.05, 8.0], 40), 20)
    for v in u:
        outputs.append([x + 1e-4 * rng.uniform(-1, 1)])
        for _ in range(50):
            x += 0.001 * (-(x**3) * np.sign(np.sin(3 * x)) + v)
    found = identify(Recording(0.05 * np.arange(len(u)), u[:, None], np.array(outputs), ("u",), ("x",)))
    assert found.fit["x"] < 0.7
    assert any(
        "The ranges do not describe any real plant, so do not trust a case file with them" in said for said in found.findings
    )


@pytest.mark.parametrize("seed", range(3))
def test_a_double_integrator_is_not_blamed_for_the_noise_of_its_initial_state(seed):
    """The first measured rate has an error of up to 0.1, and a simulation from it would deviate by half of the motion or more."""
    integrators = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    found = identify(rig(0.05, 0.1, seed, 2000, integrators, np.array([0.03, 0.25])), derivatives={"q": "w"})
    assert found.restarted is None and min(found.fit.values()) > 0.7
    assert [said for said in found.findings if "no noise bound" not in said] == []


def test_too_few_samples_of_a_period_are_a_finding():
    """Samples every 2 s of a period of 3.7 s fit a slower oscillation just as well, and exactly."""
    found = identify(rig(2.0, 1e-3, 0))
    assert min(found.fit.values()) > 0.99 and not np.allclose(found.A, PLANT[:, :2], atol=0.5)
    assert any(said.startswith("a period of the nominal plant's fastest oscillation has only ") for said in found.findings)


def test_states_at_rest_are_not_taken_for_a_wrong_plant():
    """In one recording the validation samples of one state are constant, in the other all samples of all states."""
    recording = rig(0.1, 1e-3, 0)
    still = recording.outputs.copy()
    still[300:, 1] = 0.0
    found = identify(replace(recording, outputs=still))
    assert "the held-out samples contain no motion of w, so they validate nothing about it" in found.findings
    found = identify(replace(recording, outputs=np.zeros_like(still)))
    assert np.isinf(found.rows[0].interval[:2]).all()
    assert sum("do not excite" in said for said in found.findings) == 4
    bounds = dict.fromkeys("qw", 1e-3)
    contradicted = identify(
        replace(recording, outputs=np.zeros_like(still)), noise=bounds, slope=bounds, within={("w", "u"): (0, 1)}
    )
    assert not contradicted.guaranteed


def test_bounds_that_exclude_the_plant_lead_to_an_unstable_one_inside_them():
    """A simulation of the unstable plant over the whole recording would overflow."""
    found = identify(rig(0.1, 1e-3, 0), within={("w", "w"): (30.0, 40.0)})
    assert found.rows[1].nominal[1] == pytest.approx(30.0) and found.horizon is not None
    assert any("the fit of w' lies outside the bounds of `within`" in said for said in found.findings)
    assert any("The ranges do not describe any real plant" in said for said in found.findings)


def test_noise_that_hides_the_motion_is_told_apart_from_a_wrong_plant():
    """The residual is noise as in the fit, so the plant is not called wrong."""
    found = identify(rig(0.1, 3.0, 0, N=1200))
    assert min(found.fit.values()) < 0.7
    assert any("the noise is large compared with the motion of q, w" in said for said in found.findings)
    assert not any("describe any real plant" in said or "are not noise: the correlation" in said for said in found.findings)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.short(kept=lambda seed: seed in (1, 4))
def test_the_known_set_holds_the_truth_in_absolute_values_and_behind_a_dead_time(seed):
    """The test has random plants about random operating points far from 0, with noise at its bound and inputs that arrive
    late."""
    rng = np.random.default_rng(seed)
    n, d, h, noise = int(rng.integers(1, 3)), int(rng.integers(0, 6)), 0.02, 10.0 ** rng.uniform(-5, -3)
    A, B = rng.normal(size=(n, n)), rng.normal(size=(n, 1))
    A -= (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(n)
    step = expm(np.vstack([np.column_stack([A, B]), np.zeros(n + 1)]) * h / 10)
    u, x, states, slopes = np.repeat(rng.choice([-1.0, 1.0], 60), 5), np.zeros(n), [], []
    for k in range(300):
        states.append(x + noise * rng.choice([-1.0, 1.0], n))
        v = u[k - d] if k >= d else 0.0
        for _ in range(10):
            slopes.append(np.abs(A @ x + B[:, 0] * v))
            x = step[:n] @ [*x, v]
    names = tuple(f"x{i}" for i in range(n))
    point = rng.uniform(-300, 300, n + 1)
    recording = Recording(h * np.arange(300), u[:, None] + point[n], np.array(states) + point[:n], ("u",), names)
    slope = dict(zip(names, map(float, 1.1 * np.max(slopes, axis=0)), strict=True))
    found = identify(recording, noise=dict.fromkeys(names, noise * (1 + 1e-9)), slope=slope, offset=True, delay=d * h)
    for row, truth in zip(found.rows, np.column_stack([A, B]), strict=True):
        low, high = row.ranges[: n + 1].T
        assert (low <= truth).all() and (high >= truth).all() and (low <= row.nominal[: n + 1]).all()
        assert (row.nominal[: n + 1] <= high).all() and np.isfinite(row.ranges).all()
    equilibrium = np.array(list(found.operating_point.values())) - point
    np.testing.assert_allclose(A @ equilibrium[:n] + B[:, 0] * equilibrium[n], 0.0, atol=300 * noise)
