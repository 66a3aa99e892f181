"""Ensembles: any number may vary, no bit depends on lanes or threads, and a member equals its single run."""

import weakref
from dataclasses import replace

import numpy as np
import pytest

from barbalat import (
    InputError,
    L1Adaptive,
    Mrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    RobustMrac,
    Simulation,
    input_filter,
    simulate,
    simulate_ensemble,
)
from barbalat.laws import LeastSquares
from barbalat.plants import Noise, PlantInput, Sensor
from barbalat.run.engine import ensemble
from barbalat.run.kernel import members as members_module
from barbalat.run.kernel.members import Members
from barbalat.signals import Sine

REFERENCE = Sine(amplitude=3.0, frequency=0.7)
SIMULATION = Simulation(t_end=3.0, dt=1e-3)


def random_problem(rng: np.random.Generator) -> Problem:
    A_m = np.array([[0.0, 1.0], -rng.uniform(0.5, 2.0, 2)])
    return Problem(
        plant=Plant(A_m=A_m, b=[0, rng.uniform(0.5, 2)], theta=rng.uniform(-2, 2, 2), x0=rng.uniform(-1, 1, 2)),
        reference_model=ReferenceModel(k_0=rng.uniform(1, 3)),
        reference=REFERENCE,
        uncertainty=ParameterBox(lower=[-3, -2.5], upper=[rng.uniform(2, 4), 3]),
    )


def controllers(rng: np.random.Generator) -> list:
    return [
        Mrac(gamma=rng.uniform(1, 100)),
        L1Adaptive(gamma=rng.uniform(1, 100), filter=input_filter(rng.uniform(0.01, 0.1))),
        RobustMrac(tau=rng.uniform(0.1, 1), law=LeastSquares(covariance0=rng.uniform(1, 100)), c_0=[rng.uniform(0.5, 2), 1]),
    ]


@pytest.mark.parametrize("scheme", range(3))
def test_members_equal_single_runs(scheme, sample):
    rng = np.random.default_rng(scheme)
    members = [(random_problem(rng), controllers(rng)[scheme]) for _ in range(21)]
    ensemble = simulate_ensemble(members, SIMULATION)
    for i, (problem, controller) in list(enumerate(members))[:: sample(4, 1)]:  # the first and the last among them
        (alone,) = simulate(problem, [controller], SIMULATION).values()
        for name, value in alone.figures.items():
            # compiled-in numbers may be folded together, which changes roundings that 3,000 smooth steps hardly amplify
            np.testing.assert_allclose(
                np.array(ensemble.metrics.of_member(i)[name], dtype=float), np.array(value, dtype=float), rtol=1e-9, atol=1e-12
            )


def test_no_bit_depends_on_lanes_or_threads():
    rng = np.random.default_rng(7)
    members = [(random_problem(rng), L1Adaptive(gamma=10 ** rng.uniform(2, 7), filter=input_filter(0.05))) for _ in range(37)]
    results = [
        simulate_ensemble(members, SIMULATION, lanes=lanes, threads=threads).metrics
        for lanes, threads in ((1, 1), (8, 2), (32, 3))
    ]
    for name in results[0].__dataclass_fields__:
        for other in results[1:]:
            np.testing.assert_array_equal(getattr(results[0], name), getattr(other, name))


def test_some_members_diverge_and_the_others_do_not_notice():
    rng = np.random.default_rng(3)
    problem = random_problem(rng)
    gains = [10.0, 1e9, 20.0, 1e9]
    members = [(problem, Mrac(gamma=gain, projection=False)) for gain in gains]
    metrics = simulate_ensemble(members, SIMULATION).metrics
    assert np.isnan(metrics.diverged_at).tolist() == [True, False, True, False]
    assert np.isnan(metrics.max_abs_e).all(axis=1).tolist() == [False, True, False, True]
    assert metrics.of_member(1)["max_abs_u"] is None


def test_bad_ensembles():
    rng = np.random.default_rng(1)
    one, two = random_problem(rng), random_problem(rng)
    with pytest.raises(InputError, match="at least one member"):
        simulate_ensemble([], SIMULATION)
    with pytest.raises(InputError, match=r"one structure.*member 2"):
        simulate_ensemble([(one, Mrac(gamma=1)), (two, L1Adaptive(gamma=1, filter=input_filter(0.1)))], SIMULATION)
    other = Problem(plant=two.plant, reference=Sine(amplitude=1, frequency=1), uncertainty=two.uncertainty)
    with pytest.raises(InputError, match="share their signals"):
        simulate_ensemble([(one, Mrac(gamma=1)), (other, Mrac(gamma=1))], SIMULATION)


def mixed_members(count=11):
    """Members that share controllers, problems and their parts in every way. Each has a separate delay and separate noise."""
    rng = np.random.default_rng(5)
    problems = [random_problem(rng) for _ in range(2)]
    gains = [Mrac(gamma=gamma) for gamma in (1.0, 20.0)]
    found = []
    for i in range(count):
        plant = replace(problems[i % 2].plant, input=PlantInput(delay=0.05 if i % 3 else 0.0613))
        plant = replace(plant, theta=rng.uniform(-2, 2, 2)) if i % 4 else plant
        sensor = Sensor(noise=Noise(std=0.01, sample_time=0.01, seed=i % 3))
        found.append((replace(problems[i % 2], plant=plant, sensor=sensor), gains[(i // 2) % 2]))
    return found


def equal(one, other):
    for name in one.__dataclass_fields__:
        if getattr(one, name) is not None:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_a_generator_is_read_once_and_no_bit_depends_on_how_many_run_at_once(monkeypatch):
    members = mixed_members()
    expected = simulate_ensemble(members, SIMULATION, quarters=True)
    told = []
    from_generator = simulate_ensemble((member for member in members), SIMULATION, quarters=True, progress=told.append)
    assert told == sorted(told) and told[-1] == 1.0
    monkeypatch.setattr(ensemble, "MEMBERS_AT_ONCE", 3)
    few = simulate_ensemble(members, SIMULATION, quarters=True, progress=told.append)
    for found in (from_generator, few):
        equal(found.metrics, expected.metrics)
        np.testing.assert_array_equal(found.quarters, expected.quarters)
        assert found.varied == expected.varied and len(found) == len(members)


def test_progress_begins_while_members_are_read(monkeypatch):
    monkeypatch.setattr(members_module, "TOLD_EVERY", 2)
    told, seen = [], []

    def slowly():
        for member in mixed_members(8):
            seen.append(len(told))
            yield member

    class Known:
        """Members that are made one at a time, with a known number."""

        def __len__(self):
            return 8

        def __iter__(self):
            return slowly()

    simulate_ensemble(Known(), SIMULATION, progress=told.append)
    assert seen[0] == 0 and seen[-1] >= 2 and told == sorted(told) and 0 < told[0] < 0.25 and told[-1] == 1.0


def test_every_error_names_its_member():
    rng = np.random.default_rng(1)
    one, two = random_problem(rng), random_problem(rng)
    good = (one, Mrac(gamma=1.0))
    bad = {
        "member 3: theta_hat0": (two, Mrac(gamma=1.0, theta_hat0=[0.0, 0.0, 0.0])),
        "member 3: gamma": (two, Mrac(gamma=[1.0, 2.0, 3.0])),
        "member 3: all members must share their signals": (
            replace(two, reference=Sine(amplitude=1.0, frequency=1.0)),
            Mrac(gamma=1.0),
        ),
        "member 3 differs": (two, Mrac(gamma=1.0, projection=False)),
        "member 3 must be a pair": (two,),
        "member 3: a controller must have a name": (two, 5.0),
    }
    for message, member in bad.items():
        with pytest.raises(InputError, match=message):
            simulate_ensemble([good, good, member, good], SIMULATION)
    with pytest.raises(InputError, match="member 1: theta_hat0"):
        simulate_ensemble([bad["member 3: theta_hat0"], good], SIMULATION)


@pytest.mark.parametrize("members", [5, "text", {1: 2}, None])
def test_what_is_no_list_of_members(members):
    with pytest.raises(InputError, match="members must be a list of pairs"):
        simulate_ensemble(members, SIMULATION)


def test_nothing_of_a_member_is_kept_but_the_numbers_in_which_it_differs():
    rng = np.random.default_rng(2)
    problem, controller = random_problem(rng), Mrac(gamma=1.0)
    alive, most = weakref.WeakSet(), []

    def members():
        for theta in rng.uniform(-1, 1, 300):
            made = replace(problem, plant=replace(problem.plant, theta=[theta, 0.5]))
            alive.add(made.plant)
            most.append(len(alive))
            yield made, controller

    read = Members.read(members(), SIMULATION)
    assert len(read) == 300 and read.parameters.shape == (1, 300)
    assert max(most) <= 4  # the first one, the ones before and after, and the present one
    np.testing.assert_array_equal(np.unique(read.states, axis=1), read.loop.initial()[:, None])
