"""Members of a sweep that stall are not settled, and the others are as without them."""

from dataclasses import replace

import numpy as np

from barbalat import Simulation, load_case
from barbalat.open_numbers.varied import VariedObjects
from barbalat.studies import sweep
from barbalat.sweeps.known_set_draws import sampled
from barbalat.sweeps.plan import Plan
from barbalat.sweeps.study import Study
from barbalat.sweeps.sweep import run_study, worst_runs
from relay import Relay

CASE = replace(load_case("paper"), controllers=(Relay(1.0, 0.9),), simulation=Simulation(4.0, tolerance=1e-6))


def test_stalled_members_are_not_settled() -> None:
    found = sweep(CASE, vary={"controller[0].relay": "0:2:3"}, bounds=False, audit=3)
    assert found.rows.column("relay/settled").tolist() == [1.0, 0.0, 0.0]
    assert np.isfinite(found.rows.column("relay/max_abs_e[0]")).tolist() == [True, False, False]
    assert found.sentences["relay"] == "0 of 3 members follow, 1 off, 2 not settled"
    assert found.unsettled["relay"].startswith("2 stall: no step is short enough")
    assert found.evidence.shares["lost"]["relay"].count == 0
    assert found.audit.members == (0,)


def test_the_worst_run_is_one_that_does_not_stall() -> None:
    plan = Plan({}, dict(sampled(CASE, [("controller[0].relay", "uniform:-4:2")])), members=6)
    study = Study(VariedObjects(CASE, plan.paths, False), plan)
    found = run_study(study, bounds=False, audit=0)
    settled = found.column("relay/settled") == 1
    assert 0 < settled.sum() < 6
    assert settled[worst_runs(study, found)["relay"][0]]
