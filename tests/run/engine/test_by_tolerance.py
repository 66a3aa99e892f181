"""Runs with variable steps, compared with exact solutions, with SciPy's DOP853 and with sufficiently fine fixed steps."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import barbalat
from barbalat import Simulation, load_case, simulate
from barbalat.certificates.certify import certify
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import right_hand_side
from barbalat.lowering.compiled import Compiled
from barbalat.run.engine.motion import Motion
from barbalat.run.kernel import step
from barbalat.run.kernel.attempt import Attempts
from barbalat.signals import Constant, Square
from barbalat.validate import InputError

PAPER = load_case("paper")
L1 = next(c for c in PAPER.controllers if c.name == "L1")
MRAC = next(c for c in PAPER.controllers if c.name == "MRAC")


def final_state(problem, controller, tolerance, t_end):
    motion = Motion.of(ClosedLoop.of(problem, controller), problem.signals, Simulation(t_end, tolerance=tolerance), tolerance)
    while not motion.over:
        motion.further()
    return motion


def test_the_motion_is_scipys() -> None:
    """SciPy's DOP853 has the same coefficients but a different step control. At 1e-11 both have errors of some 1e-8 here."""
    loop = ClosedLoop.of(PAPER.problem, MRAC)
    rates, command = Compiled(right_hand_side(loop)), PAPER.problem.reference
    found = solve_ivp(
        lambda t, x: rates(x, np.array([float(command(np.array(t)))])), (0, 2), loop.initial(), "DOP853", rtol=1e-11, atol=1e-11
    )
    motion = final_state(PAPER.problem, MRAC, 1e-10, 2.0)
    assert motion.x == pytest.approx(found.y[:, -1], rel=1e-6)
    assert motion.steps < len(found.t)


def test_the_error_falls_as_the_tolerance() -> None:
    """The error of a step is of order 9 in its length, so a hundredth of the tolerance needs 100^(1/8) = 1.8 times as many
    steps."""
    exact = final_state(PAPER.problem, L1, 1e-11, 1.0)
    motions = [final_state(PAPER.problem, L1, tolerance, 1.0) for tolerance in (1e-5, 1e-7, 1e-9)]
    errors = [np.abs((motion.x - exact.x) / exact.x).max() for motion in motions]
    assert errors[1] < errors[0] / 20
    assert errors[2] < errors[1] / 20
    steps = [motion.steps for motion in motions]
    assert all(1.4 < more / fewer < 2.2 for fewer, more in pairwise(steps))


@pytest.mark.parametrize("controller", [L1, MRAC], ids=lambda c: c.name)
def test_the_order_is_kept_where_an_estimate_meets_its_bound(controller) -> None:
    """In Section V up to 8 s, theta_hat_1 is constant at 5 for a while, where RK4 with fixed steps is of first order."""
    given = replace(controller, gamma=1.0)
    one, other, exact = (final_state(PAPER.problem, given, tolerance, 8.0) for tolerance in (1e-5, 1e-7, 1e-10))
    assert one.choices >= 2
    assert np.abs(other.x - exact.x).max() < np.abs(one.x - exact.x).max() / 10
    assert other.x == pytest.approx(exact.x, rel=1e-3)


def test_figures_are_those_of_the_motion() -> None:
    """The figures are compared with fixed steps so fine that their instants resolve every extremum to seven digits."""
    result = simulate(PAPER.problem, [MRAC], Simulation(4.0, tolerance=1e-8))["MRAC"]
    fine = simulate(PAPER.problem, [MRAC], Simulation(4.0, 2e-5))["MRAC"]
    for name in ("max_abs_e", "tail_max_abs_e", "theta_hat_tail_min", "theta_hat_tail_max", "theta_hat_variation_rate"):
        assert result.figures[name] == pytest.approx(fine.figures[name], rel=2e-4), name  # RK4's own error there is 1e-4
    assert result.figures["rms_e"] == pytest.approx(fine.figures["rms_e"], rel=1e-4)
    assert result.figures["max_abs_u"] == pytest.approx(fine.figures["max_abs_u"], rel=1e-5)
    assert result.t[-1] == 4.0
    assert len(result.t) == len(result.x) == 2001
    at = np.searchsorted(fine.t, result.t[::500])
    assert result.x[::500] == pytest.approx(fine.x[at], abs=1e-4)


def test_the_estimates_stay_in_the_known_set() -> None:
    result = simulate(PAPER.problem, [replace(MRAC, gamma=1.0)], Simulation(8.0, tolerance=1e-5))["MRAC"]
    assert result.figures["theta_hat_tail_max"][0] <= 5.0
    assert result.envelope.theta_hat_max.max() == 5.0


def test_jumps_and_corners_of_the_command_end_steps() -> None:
    """With a square wave whose jumps are on no grid, the error decreases with the tolerance as without jumps."""
    problem = replace(PAPER.problem, reference=Square(20.0, 1.37, phase=0.2))
    one, other, exact = (final_state(problem, MRAC, tolerance, 5.0) for tolerance in (1e-5, 1e-8, 1e-11))
    assert np.abs(other.x - exact.x).max() < np.abs(one.x - exact.x).max() / 50


def test_the_measured_error_is_that_of_the_run() -> None:
    """The measured error is compared with a third run at a finer tolerance than the second one."""
    result = simulate(PAPER.problem, [L1], Simulation(1.0, tolerance=1e-5))["L1"]
    exact = simulate(PAPER.problem, [L1], Simulation(1.0, tolerance=1e-10))["L1"]
    found = np.abs(result.theta_hat - exact.theta_hat).max(axis=0) / np.abs(exact.theta_hat).max(axis=0)
    assert result.accuracy is not None
    assert result.accuracy.error["theta_hat"] == pytest.approx(found.max(), rel=0.1)
    assert "measured error" in result.numerics


def test_a_figure_that_the_tolerance_leaves_open_is_named() -> None:
    """The estimate is constant, and the remaining oscillation is due to the tolerance, as fixed steps show."""
    case = load_case("l1-output")
    loose, tight = (simulate(case.problem, case.controllers[:1], Simulation(5.0, tolerance=t))["L1 output"] for t in (1e-6, 1e-9))
    fixed = simulate(case.problem, case.controllers[:1], Simulation(5.0, 1e-4))["L1 output"].figures
    rate = "theta_hat_variation_rate"
    assert loose.figures[rate][0] > 10 * fixed[rate][0]
    assert loose.accuracy.unresolved == (rate,)
    assert loose.accuracy.figures[rate] > 1
    assert f"{rate} is not resolved: use a smaller tolerance" in loose.numerics
    assert tight.figures[rate] == pytest.approx(fixed[rate], rel=0.05)
    assert tight.accuracy.unresolved == ()


@pytest.mark.full
def test_a_tolerance_that_roundings_leave_no_room_for_ends_in_a_sentence() -> None:
    """The run is Section V near 6.9 s, where theta_hat_1 reaches its bound."""
    with pytest.raises(
        InputError, match=r"= 1e-12 is finer than 64-bit arithmetic can resolve .* such as 1e-09, or give simulation\.dt"
    ):
        final_state(PAPER.problem, L1, 1e-12, 8.0)
    assert final_state(PAPER.problem, L1, 1e-9, 8.0).t == 8.0


def test_a_divergence_is_a_result() -> None:
    case = load_case("rohrs")
    classical = next(c for c in case.controllers if c.name == "Classical")
    result = simulate(case.problem, [classical], Simulation(30.0, tolerance=1e-6))["Classical"]
    fine = simulate(case.problem, [classical], Simulation(30.0, 1e-3))["Classical"]
    assert result.diverged_at == pytest.approx(fine.diverged_at, abs=2e-3)
    assert result.verdict is not None
    assert result.verdict.kind.name == fine.verdict.kind.name
    assert result.figures["max_abs_u"] is None


def test_the_judge_finds_a_limit_cycle() -> None:
    case = load_case("rohrs")
    sigma = next(c for c in case.controllers if c.name == "Sigma-modification")
    verdict = simulate(case.problem, [sigma], Simulation(30.0, tolerance=1e-6))[sigma.name].verdict
    expected = simulate(case.problem, [sigma], Simulation(30.0, 2e-3))[sigma.name].verdict
    assert verdict.kind is expected.kind
    assert str(verdict).split(" at ")[0] == str(expected).split(" at ")[0]


def test_bits_do_not_depend_on_threads() -> None:
    simulation = Simulation(0.2, tolerance=1e-6)
    alone, together = (simulate(PAPER.problem, [L1, MRAC], simulation, threads=n) for n in (1, 2))
    assert all(alone[name].figures == together[name].figures for name in alone)
    assert all(np.array_equal(alone[name].states, together[name].states) for name in alone)


class Callable:
    """A signal of a user's own."""

    def __call__(self, t):
        return np.array([float(v) ** 2 for v in np.atleast_1d(t)])

    before = __call__


def test_refusals() -> None:
    simulation = Simulation(1.0, tolerance=1e-6)
    with pytest.raises(InputError, match=r"Callable is a Python function .*: give simulation\.dt"):
        simulate(replace(PAPER.problem, reference=Callable()), [MRAC], simulation)
    with pytest.raises(InputError, match=r"the error in each quarter needs one: give simulation\.dt"):
        barbalat.simulate_ensemble([(PAPER.problem, MRAC)], simulation, quarters=True)
    with pytest.raises(InputError, match="must be auto if a tolerance is given, got rk4"):
        Simulation(1.0, tolerance=1e-6, solver="rk4")
    with pytest.raises(InputError, match="replaces dt"):
        Simulation(1.0, 1e-3, tolerance=1e-6)
    with pytest.raises(InputError, match="needs dt, the step"):
        Simulation(1.0)


def test_a_constant_command_and_json() -> None:
    result = simulate(replace(PAPER.problem, reference=Constant(1.0)), [MRAC], Simulation(1.0, tolerance=1e-6))["MRAC"]
    assert result.simulation.as_json() == {"t_end": 1.0, "dt": None, "solver": "auto", "tolerance": 1e-6}


def test_certificates_have_no_limit_of_the_step() -> None:
    found = certify(PAPER.problem, [MRAC], Simulation(1.0, tolerance=1e-6))
    fixed = certify(PAPER.problem, [MRAC], Simulation(1.0, 1e-4))
    for name, certificate in found.items():
        assert not {"step_max", "gamma_max"} & set(certificate.values)
        assert certificate.values["error_bound"] == fixed[name].values["error_bound"]


def test_attempts_without_dense_output_are_the_same() -> None:
    """The function that is measured for the work-precision table makes the steps of a run, but sums that nothing else needs are
    associated differently."""
    whole = final_state(PAPER.problem, MRAC, 1e-7, 1.0)
    bare = whole.again(1e-7, 1.0).sparse()
    while not bare.over:
        bare.further()
    assert bare.x == pytest.approx(whole.x, rel=1e-9)
    assert (bare.steps, bare.rejected) == (whole.steps, whole.rejected)


def test_a_loop_is_traced_again_only_if_it_differs(monkeypatch) -> None:
    """A loop may differ in its numbers or in its command. The results are bit-identical whether or not it was traced before."""
    traced, program = [], Attempts.program
    monkeypatch.setattr(Attempts, "program", lambda self: traced.append(self) or program(self))
    simulation, louder = Simulation(1.0, tolerance=1e-6), replace(PAPER.problem, reference=Constant(amplitude=7.0))
    pairs = [(PAPER.problem, replace(MRAC, gamma=0.37)), (PAPER.problem, replace(MRAC, gamma=0.38))]
    pairs.append((replace(PAPER.problem, reference=replace(PAPER.problem.reference, amplitude=7.0)), pairs[0][1]))
    pairs.append((louder, pairs[0][1]))

    def ends():
        return [simulate(*pair, simulation)["MRAC"].states[-1].tobytes() for pair in pairs]

    monkeypatch.setattr(step, "_programs", {})
    first = ends()
    assert len(traced) == len(set(first)) == 4
    assert ends() == first
    assert len(traced) == 4
    monkeypatch.setattr(step, "_programs", {})
    assert ends() == first
    assert len(traced) == 8
