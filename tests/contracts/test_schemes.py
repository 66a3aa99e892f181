"""The contract of every registered scheme: a new scheme is added to SCHEMES, has an example in independent.py, and is tested
here."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, fields
from functools import cache

import numpy as np
import pytest

from barbalat.controllers import SCHEMES, BaselineAlone, Mrac
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.state_feedback import ParameterBox, Plant, Problem
from barbalat.protocols import Controller
from barbalat.roles import THETA, Estimating, roles_of
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Constant, Sine
from barbalat.solvers import SOLVERS
from barbalat.solvers.simulation import Simulation
from independent import brute_force, example_controllers, jacobian_against_differences, refusal, symbols_against_numbers

ORDERS = (1, 2, 3)
EXAMPLES = [(name, n, i) for name in SCHEMES for n in ORDERS for i in range(len(example_controllers(n).get(name, [None])))]

SHORT_PAIRS = ((1, "euler"), (2, "rk4"), (3, "heun"))
"""The short tests vary order and solver together. Tests that do not depend on the order use only the second one."""


def kept_in_short(example, solver):
    """Whether the short tests keep a pair: the second pair of every example, and alternately the first or the third."""
    _, n, i = example
    return (n, solver) in (SHORT_PAIRS[1], SHORT_PAIRS[i % 2 * 2])


@pytest.fixture(params=EXAMPLES, ids=[f"{name}-n{n}-{i}" for name, n, i in EXAMPLES])
def example(request, problems):
    name, n, i = request.param
    table = example_controllers(n)
    if name not in table:
        pytest.fail(f"the scheme {name!r} is registered but has no example settings: add them to tests/independent.py")
    return problems[n], table[name][i]


@pytest.fixture
def adaptive(example):
    """Whether an example estimates parameters or numbers derived from them. Examples without estimates are exempt here."""
    problem, controller = example
    equations = controller.bind(problem.known)
    if not isinstance(equations, Estimating):
        pytest.skip("estimates nothing")
    role = roles_of(equations)["theta_hat"]
    if role.of != THETA and role.true is None:
        pytest.skip("its weights are no parameters: no known set holds them")
    return example


@cache
def long_run(problem, controller):
    """A run of 64 s, which is ten periods of the slowest command and enough for the estimates to converge."""
    return simulate(problem, [controller], Simulation(t_end=64.0, dt=2.0**-6))[controller.name]


@pytest.mark.short(kept=lambda example: example[1] == 2)
def test_the_registry_knows_the_class(example):
    _, controller = example
    assert type(controller) in SCHEMES.values()
    assert isinstance(controller, Controller)
    assert isinstance(controller.name, str)


@pytest.mark.short(kept=lambda example: example[1] > 1)
def test_symbols_and_numbers_agree(example):
    symbols_against_numbers(ClosedLoop.of(*example), size=3.0)


@pytest.mark.short(kept=lambda example: example[1] == 2)
def test_the_flat_state_and_its_parts(example):
    problem, controller = example
    loop = ClosedLoop.of(problem, controller)
    parts = loop.unpack(loop.initial())
    assert parts.x.tolist() == parts.x_m.tolist() == problem.plant.x0.tolist()
    marked = np.arange(loop.size)
    assert marked[loop.theta_hat_rows].tolist() == loop.theta_hat(loop.unpack(marked).controller).tolist()
    with pytest.raises(ValueError, match="entries"):
        loop.unpack(np.zeros(loop.size + 1))


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.short(kept=kept_in_short)
def test_the_kernel_does_what_plain_stepping_does(example, solver):
    """Machine code, tables, blocks and record agree with a Python loop over the textbook formulas.

    The tolerance is 1e-9: 160 steps with roundings of 1e-16 times terms up to 1e3, in loops that do not amplify.
    """
    problem, controller = example
    dt, steps = 2.0**-7, 160
    samples = brute_force(ClosedLoop.of(problem, controller), problem.signals, solver, dt, steps)
    simulation = Simulation(t_end=steps * dt, dt=dt, solver=SOLVERS[solver], record_points=steps)
    result = simulate(problem, [controller], simulation)[controller.name]
    assert len(result.t) == steps + 1
    np.testing.assert_allclose(result.e, samples.e, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result.theta_hat, samples.theta_hat, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result.u, samples.u, rtol=0, atol=1e-8)  # u multiplies theta_hat by x and adds 1/tau times e


def with_setting(controller, **changes):
    """The given settings with some of them replaced."""
    return type(controller)(**({f.name: getattr(controller, f.name) for f in fields(controller)} | changes))


@pytest.mark.short(kept=lambda example: example[1] == 2)
def test_the_estimate_stays_in_a_box_that_it_wants_to_leave(adaptive):
    """The box ends at 0.8 theta, and the estimate starts in its corner, so the law drives it outward. It stays inside at every
    step, exactly."""
    problem, controller = adaptive
    corner = 0.8 * problem.plant.theta
    box = ParameterBox(lower=-np.abs(corner), upper=np.abs(corner))
    given = Problem(plant=problem.plant, reference_model=problem.reference_model, reference=problem.reference, uncertainty=box)
    started = with_setting(controller, theta_hat0=corner)
    simulation = Simulation(t_end=16.0, dt=2.0**-7)
    inside = simulate(given, [started], simulation)[controller.name]
    outside = simulate(given, [with_setting(started, projection=False)], simulation)[controller.name]
    assert inside.diverged_at is None
    assert (inside.envelope.theta_hat_min >= box.lower).all()
    assert (inside.envelope.theta_hat_max <= box.upper).all()
    assert (np.abs(outside.theta_hat) > box.upper).any()  # without the box it would leave


@pytest.mark.short(kept=lambda example: example[1] == 2)
def test_tracking_at_a_moderate_gain(example):
    """The tail error is a fraction of the error without adaptation (theta_hat = 0), as is the purpose of adaptation."""
    problem, controller = example
    left_alone = long_run(problem, Mrac(gamma=1e-30))
    adapted = long_run(problem, controller)
    if (
        isinstance(controller, BaselineAlone) and controller.nominal is None
    ):  # it is the same plant up to roundings of its operation list
        assert adapted.diverged_at == left_alone.diverged_at
        if adapted.diverged_at is None:
            assert adapted.figures["tail_max_abs_e"] == pytest.approx(left_alone.figures["tail_max_abs_e"], rel=1e-12)
        return
    assert adapted.diverged_at is None
    if isinstance(controller, BaselineAlone):  # its fixed gains keep the loop bounded but need not reduce the error
        return
    limit = np.inf if left_alone.diverged_at else max(left_alone.figures["tail_max_abs_e"])
    assert max(adapted.figures["tail_max_abs_e"]) < 0.75 * limit


@pytest.mark.short(kept=lambda example: example[1] == 2)
def test_shapes_and_numbers_of_a_result(example):
    problem, controller = example
    n, result = problem.plant.n, long_run(problem, controller)
    count = len(result.t)
    assert result.t[0] == 0
    if isinstance(controller, BaselineAlone) and result.diverged_at:  # nothing stabilises the plant, so the record ends there
        assert 0 < result.t[-1] <= result.diverged_at
        assert long_run(problem, Mrac(gamma=1e-30)).diverged_at
    else:
        assert result.t[-1] == 64
    assert (np.diff(result.t) > 0).all()
    estimates = ClosedLoop.of(problem, controller).parameters
    for name in ("x", "x_m", "e"):
        assert getattr(result, name).shape == (count, n)
    assert result.theta_hat.shape == (count, estimates)
    assert result.u.shape == result.r.shape == (count,)
    for field in fields(result.envelope):
        size = {"u": 1, "e": n, "theta_hat": estimates}[field.name.rsplit("_", 1)[0]]
        expected = (count - 1, size)
        assert getattr(result.envelope, field.name).shape == expected
    for value in [*result.columns().values(), result.stiffness.h_lambda_max]:
        assert np.isfinite(value).all()
    np.testing.assert_allclose(result.e, result.x - result.x_m, atol=1e-14)
    np.testing.assert_allclose(result.r, problem.reference(result.t), rtol=1e-14)
    assert result.name == controller.name
    assert controller.name == result.controller.name


@pytest.mark.short(kept=lambda example: example[1] == 2)
def test_the_exact_jacobian_against_differences(example):
    jacobian_against_differences(ClosedLoop.of(*example))


@pytest.mark.short(kept=lambda example: example[1] == 2)
def test_projection_is_on_where_the_set_is_known_and_can_be_switched_off(adaptive):
    problem, controller = adaptive
    assert controller.bind(problem.known).estimate_set is problem.uncertainty
    without = Problem(plant=problem.plant, reference=problem.reference)
    assert controller.bind(without.known).estimate_set is None
    assert with_setting(controller, projection=False).bind(problem.known).estimate_set is None
    assert "uncertainty" in refusal(lambda: with_setting(controller, projection=True).bind(without.known))


@pytest.mark.parametrize("theta_hat0", [np.zeros(5), [1e6], "0", [np.nan]])
@pytest.mark.short(kept=lambda example, theta_hat0: example[1] == 2)
def test_a_misfit_is_refused(adaptive, theta_hat0):
    problem, controller = adaptive
    assert "theta_hat0" in refusal(lambda: with_setting(controller, theta_hat0=theta_hat0).bind(problem.known))


@pytest.mark.short(kept=lambda example: example[1] == 2)
def test_settings_are_frozen(example):
    _, controller = example
    for field in fields(controller):
        with pytest.raises(FrozenInstanceError):
            setattr(controller, field.name, 1.0)


@pytest.mark.short(kept=lambda example: example[1] == 2)
def test_settings_do_not_share_what_the_user_may_change(adaptive):
    """The initial estimate does not change if the given array is changed afterwards."""
    problem, controller = adaptive
    given = np.full(problem.plant.n, 0.1)
    settings = with_setting(controller, theta_hat0=given)
    given[:] = 0.2
    assert settings.bind(problem.known).initial().theta_hat.tolist() == [0.1] * problem.plant.n


@pytest.mark.short(kept=lambda example: example[1] == 1)
def test_the_initial_estimate_is_where_the_run_starts(adaptive):
    problem, controller = adaptive
    started = with_setting(controller, theta_hat0=[0.5] * problem.plant.n)
    result = simulate(problem, [started], Simulation(t_end=0.25, dt=2.0**-6))[controller.name]
    assert result.theta_hat[0].tolist() == [0.5] * problem.plant.n


@pytest.mark.short(kept=lambda example: example[1] == 2)
def test_rest_stays_rest(example):
    """With x(0) = 0, r = 0 and d = 0 nothing moves, not even by a rounding."""
    given, controller = example
    p = given.plant
    problem = Problem(plant=Plant(A_m=p.A_m, b=p.b, theta=p.theta), reference=Constant(0.0))
    result = simulate(problem, [controller], Simulation(t_end=1.0, dt=2.0**-6))[controller.name]
    for value in (result.x, result.u, result.theta_hat - result.theta_hat[0], result.e):
        assert not value.any()


@pytest.mark.short(kept=lambda example: example[1] == 1)
def test_a_disturbance_reaches_the_plant(example):
    """With d the run differs. With d = 0 the run equals the run without d, up to roundings of sums in a different order."""
    given, controller = example
    arguments = {"plant": given.plant, "reference": given.reference, "uncertainty": given.uncertainty}
    simulation = Simulation(t_end=4.0, dt=2.0**-8)
    without, zero, some = (
        simulate(Problem(**arguments, disturbance=d), [controller], simulation)[controller.name]
        for d in (None, Constant(0.0), Sine(1.0, 2.0))
    )
    np.testing.assert_allclose(zero.x, without.x, atol=1e-11)
    assert np.abs(some.x - without.x).max() > 1e-2
