"""The bound for a member is the certified bound for the member's case."""

import numpy as np
import pytest

from barbalat import certify
from barbalat.cases.load import CaseText
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.varied import VariedCase
from barbalat.sweeps.bounds import Bounds
from barbalat.sweeps.plan import Plan
from barbalat.sweeps.spread import Axis, Uniform
from barbalat.sweeps.study import Study

TEXT = """
name = "second order"
plant = { A_m = [[0.0, 1.0], [-2.0, -2.0]], b = [0.0, 1.0], theta = [1.5, -1.0] }
reference_model = { k_0 = 2.0 }
reference = { kind = "sine", amplitude = 1.3, frequency = 0.9 }
uncertainty = { lower = [-2.0, -2.0], upper = [2.0, 2.0] }
simulation = { t_end = 1.0, dt = 1e-3 }
controller = [{ name = "MRAC", scheme = "mrac", gamma = 30.0 }]
"""
FIRST, EDGE, GAIN = (FieldPath.parse(name) for name in ("plant.theta[0]", "uncertainty.upper[0]", "controller[0].gamma"))
EDGES = Axis(0.1, 2.0, 3)


@pytest.mark.parametrize("axes", [{EDGE: EDGES, FIRST: Axis(-1.9, 1.9, 5)}, {EDGE: EDGES, GAIN: Axis(1.0, 9.0, 2)}])
@pytest.mark.short(kept=lambda axes: GAIN in axes)
def test_no_member_has_a_bound_that_its_own_case_has_not(axes):
    """The known set varies too. A theta in the first member's set may be outside the set of the member that has this theta, where
    nothing is guaranteed."""
    plan = Plan(axes, {}, 1)
    study = Study(VariedCase(CaseText(TEXT), plan.paths), plan)
    rows = plan.values(0, len(plan))
    found, seen = Bounds(study).of(rows), set()
    for k, row in enumerate(rows):
        case = study.varied.at(row)
        for name, certificate in certify(case.problem, case.controllers, case.simulation).items():
            own = certificate.values.get("error_bound") if "error_bound" in certificate.guaranteed else None
            assert np.isnan(found[name][k]) or (own is not None and found[name][k] >= own)
            seen.add((name, bool(np.isnan(found[name][k]))))
    assert seen == {("MRAC", False), ("MRAC", True)}


@pytest.mark.parametrize(("count", "any_bound"), [(64, True), (65, False)])
def test_whether_bounds_are_compared_is_known_from_the_plan_and_not_from_what_ran_first(count, any_bound):
    plan = Plan({GAIN: Axis(1.0, 9.0, count), FIRST: Axis(-1.0, 1.0, 100)}, {}, 1)  # theta needs one certificate for all
    study = Study(VariedCase(CaseText(TEXT), plan.paths), plan)
    assert np.isfinite(Bounds(study).of(plan.values(0, 3))["MRAC"]).all() == any_bound


def test_what_varies_of_another_controller_takes_no_bound_away_and_what_is_not_compared_is_said():
    text = TEXT.replace("gamma = 30.0 }]", 'gamma = 30.0 }, { name = "other", scheme = "mrac", gamma = 30.0 }]')
    gamma = FieldPath.parse("controller[1].gamma")
    plan = Plan({}, {gamma: Uniform(1.0, 9.0)}, 65)
    bounds = Bounds(Study(VariedCase(CaseText(text), plan.paths), plan))
    found = bounds.of(plan.values(0, 3))
    assert np.isfinite(found["MRAC"]).all() and np.isnan(found["other"]).all()
    assert len(bounds.notes) == 1 and bounds.notes[0].startswith("other: no bound is compared") and "65 comb" in bounds.notes[0]
