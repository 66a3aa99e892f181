"""Ensembles: any number may vary, no bit depends on lanes or threads, and a member is the run that it would be alone."""

import numpy as np
import pytest

from barbalat import (
    InputError,
    L1Adaptive,
    LeastSquares,
    Mrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    RobustMrac,
    Simulation,
    Sine,
    input_filter,
    simulate,
    simulate_ensemble,
)

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
            # numbers compiled in may be folded together: that changes roundings, which 3,000 smooth steps hardly amplify
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
