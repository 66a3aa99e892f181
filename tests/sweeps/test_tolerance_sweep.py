"""A sweep of a case with a tolerance, compared with the same sweep at fixed steps."""

from dataclasses import replace

import numpy as np
import pytest

from barbalat import Simulation, load_case, simulate, simulate_ensemble
from barbalat.budget import Budget
from barbalat.controllers.sampled import Sampled
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.varied import VariedObjects
from barbalat.plants import PlantInput
from barbalat.problem.faults import Dropout, Jitter
from barbalat.problem.measurement import Noise, Sensor
from barbalat.sweeps.known_set_draws import sampled
from barbalat.sweeps.plan import Plan
from barbalat.sweeps.study import Study
from barbalat.sweeps.sweep import run_study, sweep, worst_runs
from barbalat.validate import InputError

CASE = load_case("paper")
SLOW = tuple(replace(c, gamma=0.1) for c in CASE.controllers if c.name == "MRAC")


def swept(simulation, **how):
    case = replace(CASE, controllers=SLOW, simulation=simulation)
    return sweep(case, sample={"plant.theta[0]": "uniform:2:4"}, members=12, bounds=False, audit=3, **how)


def test_figures_and_verdicts_are_those_of_fixed_steps() -> None:
    ours, fixed = swept(Simulation(20.0, tolerance=1e-8)), swept(Simulation(20.0, 1e-3))
    for name in ("max_abs_e[0]", "rms_e[1]", "tail_max_abs_e[0]", "theta_hat_final[1]", "verdict", "settled"):
        assert ours.rows.column(f"MRAC/{name}") == pytest.approx(fixed.rows.column(f"MRAC/{name}"), rel=1e-3), name
    said = ours.audit.sentences[0]
    assert said.startswith("no verdict changed in ") and "members repeated at 1/32 of the tolerance (" in said
    assert ours.audit.as_json()["finer_by"] == 32


def test_the_recorded_run_of_the_worst_member_is_that_member() -> None:
    """The noise of the worst member differs from that of the other members. The extrema of the record equal the sweep's, up to
    the motion between recorded instants."""
    problem = replace(CASE.problem, sensor=Sensor(noise=Noise(std=0.05, sample_time=0.1, seed=3)))
    case = replace(CASE, problem=problem, controllers=SLOW, simulation=Simulation(4.0, tolerance=1e-8))
    plan = Plan({}, dict(sampled(case, [("plant.theta[0]", "uniform:2:4")])), members=6, seed=1)
    study = Study(VariedObjects(case, plan.paths, False), plan)
    found = run_study(study, bounds=False, audit=0)
    member, result = worst_runs(study, found)["MRAC"]
    assert member > 0
    assert np.abs(result.e[:, 0]).max() == pytest.approx(found.rows.column("MRAC/max_abs_e[0]")[member], rel=1e-4)
    assert result.theta_hat[-1, 1] == pytest.approx(found.rows.column("MRAC/theta_hat_final[1]")[member], rel=1e-7)


@pytest.mark.parametrize(
    ("path", "values"),
    [("reference.amplitude", (5.0, 10.0, 15.0)), ("faults[0].seed", (0, 1, 2)), ("faults[1].time", (1e-3, 2e-3))],
)
def test_members_with_signals_of_their_own_are_single_runs(path, values) -> None:
    """All members once had the middle member's command and faults."""
    faults = (Dropout(share=0.3), Jitter(time=0.001, seed=1))
    problem, simulation = replace(CASE.problem, faults=faults), Simulation(1.0, tolerance=1e-8)
    controller = Sampled(SLOW[0], 0.02)
    case = replace(CASE, problem=problem, controllers=(controller,), simulation=simulation)
    found = sweep(case, vary={path: f"{values[0]}:{values[-1]}:{len(values)}"}, bounds=False, audit=0).rows.column(
        "MRAC/rms_e[1]"
    )
    alone = []
    for value in values:
        if path == "reference.amplitude":
            one = replace(problem, reference=replace(problem.reference, amplitude=value))
        else:
            place, name = int(path[7]), path.split(".")[1]
            one = replace(problem, faults=tuple(replace(f, **{name: value}) if i == place else f for i, f in enumerate(faults)))
        alone.append(simulate(one, [controller], simulation)["MRAC"].figures["rms_e"][1])
    assert found == pytest.approx(np.array(alone), rel=1e-9)
    assert len(np.unique(found)) == len(values)


@pytest.mark.parametrize("path", ["plant.theta[0]", "plant.input.delay"])
def test_every_member_has_its_own_delay(path) -> None:
    """The kernel is made of five examples, whose delays all members once had."""
    problem = replace(CASE.problem, plant=replace(CASE.problem.plant, input=PlantInput(delay=0.02)))
    case = replace(CASE, problem=problem, controllers=SLOW, simulation=Simulation(3.0, tolerance=1e-8))
    values = np.linspace(*((2.0, 4.0) if "theta" in path else (0.01, 0.08)), 9)
    found = sweep(case, vary={path: f"{values[0]}:{values[-1]}:9"}, bounds=False, audit=0).rows.column("MRAC/max_abs_e[0]")
    for value, figure in zip(values, found, strict=True):
        one = VariedObjects(case, (FieldPath.parse(path),), False).at([value])
        (alone,) = simulate(one.problem, one.controllers, one.simulation).values()
        assert figure == pytest.approx(alone.figures["max_abs_e"][0], rel=1e-9)


@pytest.mark.parametrize("faults", [(), (Dropout(share=0.2), Jitter(time=0.001, seed=1))], ids=["regular", "jitter"])
def test_a_sampled_controller_without_fused_sums_is_the_same(faults) -> None:
    """The kernel then takes all numbers as arguments, but its samples have instants."""
    problem, found = replace(CASE.problem, faults=faults), []
    for fused in (True, False):
        simulation = Simulation(1.0, tolerance=1e-9, fused=fused)
        case = replace(CASE, problem=problem, controllers=(Sampled(SLOW[0], 0.02),), simulation=simulation)
        rows = sweep(case, vary={"plant.theta[0]": "2:4:3"}, bounds=False, audit=0).rows
        found.append(rows.column(f"{case.controllers[0].name}/max_abs_e[0]"))
    assert found[0] == pytest.approx(found[1], rel=1e-7)


def test_the_budget_counts_what_the_tolerance_costs() -> None:
    """L1 up to 20 s with its gain of 1e4 needs half a million attempts, 0.2 s for each member. Only 0.03 ms used to be
    counted."""
    l1 = tuple(c for c in CASE.controllers if c.name == "L1")
    case = replace(CASE, controllers=l1, simulation=Simulation(20.0, tolerance=1e-6))
    refused = r"would take about \d\d\.?\d* min of computing, more than the budget"
    with Budget(seconds=60.0), pytest.raises(InputError, match=refused):
        sweep(case, sample={"plant.theta[0]": "uniform:2:4"}, members=10_000, bounds=False)
    with Budget(seconds=60.0), pytest.raises(InputError, match=refused):
        simulate_ensemble([(case.problem, l1[0])] * 10_000, case.simulation)
    with Budget(seconds=60.0):  # which slow adaptation does not need
        assert len(swept(Simulation(4.0, tolerance=1e-6)).rows.column("member")) == 12


def test_bits_do_not_depend_on_threads() -> None:
    one, other = (swept(Simulation(4.0, tolerance=1e-6), threads=n).rows for n in (1, 2))
    assert all(np.array_equal(one.column(name), other.column(name), equal_nan=True) for name in one.names)


def test_other_computers_take_fixed_steps() -> None:
    with pytest.raises(InputError, match=r"a sweep on other computers needs one: give simulation\.dt"):
        swept(Simulation(4.0, tolerance=1e-6), scheduler="tcp://127.0.0.1:9")
