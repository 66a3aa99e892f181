"""The judge's operation list in kernels, along recorded signals and in NumPy, compared with formulas over all instants of a
recorded run."""

import numpy as np
import pytest

from barbalat import Mrac, ParameterBox, Plant, Problem, ReferenceModel, Simulation
from barbalat.judge.along import along
from barbalat.judge.appended import Watched
from barbalat.judge.judged import Kept
from barbalat.judge.memory import Memory, Sample
from barbalat.judge.settings import Judge
from barbalat.plants import Noise, PlantInput, Sensor
from barbalat.run.engine.engine import Batch, run
from barbalat.run.engine.judging import kept_of, watched_in_runs
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Square


def problem(**given) -> Problem:
    return Problem(
        plant=Plant(A_m=[[0.0, 1.0], [-4.0, -3.0]], b=[0.0, 1.0], theta=[2.0, -1.0], x0=[0.5, 0.0], **given),
        reference_model=ReferenceModel(k_0=4.0),
        reference=Square(1.0, np.pi / 4),  # its jumps are on the grid
        uncertainty=ParameterBox(lower=[-3, -3], upper=[3, 3]),
        sensor=Sensor(noise=Noise(std=[0.01, 0.05], sample_time=0.01, seed=4)),
    )


def largest_so_far(v: np.ndarray) -> np.ndarray:
    """The range that v has covered, or its magnitude if that is larger, up to each instant."""
    covered = np.maximum.accumulate(v) - np.minimum.accumulate(v)
    return np.maximum(covered, np.maximum.accumulate(np.abs(v)))


SIMULATION = Simulation(t_end=20.0, dt=0.005, record_points=4000)
LIMITS = {
    "none": {},
    "limits": {"input": PlantInput(saturation=[-4.0, 5.0])},
    "rate limit": {"input": PlantInput(saturation=[-4.0, 5.0], rate_limit=40.0)},
}


def reversals(v: np.ndarray, widths: np.ndarray) -> int:
    """How often v moves back by more than ``widths`` from its farthest point since the last reversal."""
    count, rising, high, low = 0, True, v[0], v[0]
    for value, width in zip(v[1:], widths[1:], strict=True):
        high, low = max(high, value), min(low, value)
        if rising and high - value > width:
            count, rising, low = count + 1, False, value
        elif not rising and value - low > width:
            count, rising, high = count + 1, True, value
    return count


@pytest.fixture(params=LIMITS)
def recorded(request):
    """A run with every instant kept, and the judge's result."""
    posed, judge = problem(**LIMITS[request.param]), Judge()
    (result,) = simulate(posed, [Mrac(gamma=20.0)], SIMULATION).values()
    watched = watched_in_runs(judge, posed)
    batch = Batch.of([(posed, Mrac(gamma=20.0))], SIMULATION, watched=watched)
    run([batch], posed.signals, SIMULATION)
    return posed, result, kept_of(batch)


def limited_of(posed, result) -> np.ndarray:
    (path,) = posed.input_paths
    if path is None:
        return result.u
    if path.rate_limit is not None:
        return np.array([result.loop.unpack(state).input[0].limited[0] for state in result.states])
    return np.clip(result.u, *path.saturation)


def at_limit_of(path, u, v):
    """Whether the demand is beyond a limit and the control ``v`` has reached it."""
    low, high = path.saturation
    asked = np.clip(u, low, high)
    return ((u <= low) | (u >= high)) & (np.abs(asked - v) <= 1e-3 * (high - low))


def test_every_quantity_is_what_the_recorded_signals_give(recorded):
    posed, result, kept = recorded
    assert len(result.t) == SIMULATION.steps + 1
    v, tail = limited_of(posed, result), slice(SIMULATION.tail_start, None)
    expected = {
        "largest y_m": np.abs(result.x_m).max(axis=0),
        "largest y": np.abs(result.x).max(axis=0),
        "largest e": np.abs(result.e[tail]).max(axis=0),
        "low": v[tail].min(),
        "high": v[tail].max(),
        "path": np.abs(np.diff(v)).sum(),
        "steps": SIMULATION.steps + 1,
        "IAE": np.abs(result.e).sum(axis=0),
        "ITAE": (np.arange(len(result.t)) @ np.abs(result.e)),
    }
    (path,) = posed.input_paths
    if path is not None and path.saturation is not None:
        low, high = path.saturation
        expected["at limit"] = at_limit_of(path, result.u, v).sum()
        widths = np.full(len(v), 0.025 * (high - low))
    else:
        parts = v[: SIMULATION.tail_start], v[tail]
        widths = 0.025 * np.concatenate([largest_so_far(part) for part in parts])
    if path is not None and path.rate_limit is not None:
        asked = np.clip(result.u, *path.saturation)
        expected["at rate limit"] = (np.abs(asked - v) >= path.rate_limit * SIMULATION.dt).sum()
    for name, value in expected.items():
        np.testing.assert_allclose(kept.of(name)[0], np.atleast_1d(value), rtol=1e-11, atol=1e-12, err_msg=name)
    counted = int(kept.of("reversals")[0, 0])
    assert counted == reversals(v, widths)
    assert counted > 10


def test_along_recorded_signals_the_list_gives_what_it_gave_in_the_kernel(recorded):
    posed, result, kept = recorded
    (path,) = posed.input_paths
    v, nothing = limited_of(posed, result), np.zeros(len(result.t))
    at_limit = at_rate_limit = nothing
    if path is not None:
        at_limit = at_limit_of(path, result.u, v).astype(float)
        if path.rate_limit is not None:
            asked = np.clip(result.u, *path.saturation)
            at_rate_limit = (np.abs(asked - v) >= path.rate_limit * SIMULATION.dt).astype(float)
    columns = (result.x, result.x_m, result.e, result.u, v, at_limit, at_rate_limit, result.r, np.ones(len(result.t)))
    samples = Sample(*(np.reshape(part, (len(result.t), -1)) for part in columns))
    ranges = np.array([1.0 if path is None else np.ptp(path.saturation)])
    start = SIMULATION.tail_start
    head, tail = (Sample(*(part[which] for part in samples)) for which in (slice(0, start), slice(start, None)))
    before = along(kept.memory, head, ranges)
    np.testing.assert_allclose(before, kept.before_tail[:, 0], rtol=1e-9, atol=1e-9)
    whole = along(kept.memory, tail, ranges, start=before, renewed=True)
    own = slice(0, kept.memory.responses.start)  # the run's last instant is not a step of the command
    np.testing.assert_allclose(whole[own], kept.whole[own, 0], rtol=1e-9, atol=1e-9)


def test_the_same_lines_in_numpy():
    memory = Memory(1, 1, 1, limited=(False,), rate_limited=(False,), hysteresis=0.025, detailed=True)
    t = np.linspace(0, 20, 400)
    y, u = np.sin(t)[:, None], (np.sin(3 * t) * np.exp(-0.1 * t))[:, None]
    zero, one = np.zeros((len(t), 1)), np.ones((len(t), 1))
    samples = Sample(y, 0.9 * y, 0.1 * y, u, u, zero, zero, zero, one)
    kept = np.array(memory.begins)
    for k in range(len(t)):
        kept = memory.update(kept, Sample(*(part[k] for part in samples))._replace(steps=1.0), np.ones(1))
    np.testing.assert_allclose(along(memory, samples, np.ones(1)), kept, rtol=1e-12)
    assert kept[memory.places["reversals"]] == reversals(u[:, 0], 0.025 * largest_so_far(u[:, 0]))


@pytest.mark.parametrize("offset", [0.0, 7.0])
def test_swings_are_the_way_between_turns_of_the_tail(offset):
    """The swings are found from the extremes of the whole path, for any mean of the control."""
    memory, one = Memory(1, 1, 1, limited=(True,), rate_limited=(False,), hysteresis=0.025, weighed=True), np.ones((3000, 1))
    t = np.linspace(0, 30, 3000)
    u = (offset + np.sin(2 * t) + 0.3 * np.sin(9 * t))[:, None]
    samples, ranges = Sample(u, u, u, u, u, 0 * one, 0 * one, u, one), np.array([4.0])
    for start in (2000, 2040, 2090):  # after an odd and an even number of reversals
        head, tail = (Sample(*(part[which] for part in samples)) for which in (slice(0, start), slice(start, None)))
        before = along(memory, head, ranges)
        whole = along(memory, tail, ranges, start=before, renewed=True)
        kept = Kept(memory, before[:, None], whole[:, None])
        assert kept.swings[0, 0] == pytest.approx(np.abs(np.diff(u[start:, 0])).sum() / 4.0, abs=1.0)


def test_no_bit_of_a_run_depends_on_the_judge():
    posed = problem(**LIMITS["rate limit"])
    found = []
    for watched in (None, Watched(0.025), watched_in_runs(Judge(), posed)):
        batch = Batch.of([(posed, Mrac(gamma=20.0))] * 3, SIMULATION, record=True, watched=watched)
        run([batch], posed.signals, SIMULATION)
        blocks = batch.blocks(SIMULATION)
        found.append([blocks.states, blocks.accumulators, batch.final_states, *vars(batch.metrics(SIMULATION)).values()])
    plain, *judged = found
    for other in judged:
        assert all((a is None and b is None) or a.tobytes() == b.tobytes() for a, b in zip(plain, other, strict=True))


def test_step_figures_are_those_of_python_control():
    control = pytest.importorskip("control")
    from labelled_runs import Gain

    plant = Plant(A_m=[[0.0, 1.0], [-4.0, -1.2]], b=[0.0, 4.0], theta=[0.0, 0.0])
    posed = Problem(plant=plant, reference_model=ReferenceModel(k_0=1.0), reference=Square(1.0, np.pi / 20, constant=1.0))
    simulation = Simulation(t_end=40.0, dt=0.001)
    judge = Judge(follows={"x_1": 0.04})  # 2 % of the step
    (result,) = simulate(posed, [Gain(k=np.zeros(2))], simulation, judge=judge).values()  # u = r: x is x_m
    found = result.verdict.figures.responses
    asked = control.step_info(control.tf([4.0], [1, 1.2, 4]), T=np.arange(0, 20, 0.001), SettlingTimeThreshold=0.02)
    assert list(found) == ["x_1"]  # the speed comes back to 0
    assert found["x_1"].Overshoot == pytest.approx(asked["Overshoot"], rel=1e-4)
    assert found["x_1"].RiseTime == pytest.approx(asked["RiseTime"], abs=0.0021)
    assert found["x_1"].SettlingTime == pytest.approx(asked["SettlingTime"], abs=0.0021)


def test_a_response_that_does_not_settle_has_no_settling_time():
    from labelled_runs import Gain

    plant = Plant(A_m=[[-1.0]], b=[1.0], theta=[0.0])
    posed = Problem(plant=plant, reference_model=ReferenceModel(k_0=1.0), reference=Square(1.0, np.pi / 0.5))
    (result,) = simulate(posed, [Gain(k=np.zeros(1))], Simulation(t_end=10.0, dt=0.01)).values()
    assert result.verdict.figures.responses["x_1"].SettlingTime is None
    assert result.verdict.figures.responses["x_1"].RiseTime is None
