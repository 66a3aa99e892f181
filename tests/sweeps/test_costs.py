"""What a sweep costs, measured before it is run: against what is counted by hand of its members."""

from __future__ import annotations

import pytest

from barbalat.cases.load import CaseText
from barbalat.sweeps.costs import Costs
from barbalat.sweeps.plan import Plan
from barbalat.sweeps.study import Study
from barbalat.sweeps.varied_case import VariedCase, sampled


def test_bytes_are_those_of_the_members_numbers_and_figures():
    pytest.importorskip("pyarrow")
    head = CaseText.read("paper").text.split("[[controller]]")[0].replace("dt = 1e-4", "dt = 1e-2")
    text = CaseText(head + '[[controller]]\nname = "MRAC"\nscheme = "mrac"\ngamma = 0.1\n')
    plan = Plan({}, sampled(text, [("plant.theta", "known-set")]), 4000)
    study = Study(VariedCase(text, plan.paths), plan)
    costs = Costs.of(study)
    assert costs.steps == 6000 and costs.chunk(10**6) == 33_333
    (part,) = study.parts(0, 1)
    numbers = sum(len(one.parameters) + len(one.states) for one in part.members)
    assert 8 * numbers <= costs.sent <= 8 * numbers + 200_000 / 4000  # what a chunk has once: the operation list
    names = [name for name in study.run(0, 1) if "/" in name and not name.endswith("oscillated")]
    assert 8 * len(names) <= costs.returned <= 8 * len(names) + 1
    assert 0 < costs.client < costs.worker and costs.stored > 8 * 5  # draws and errors have no digits to spare
    assert costs.tables == pytest.approx(24 * costs.steps, rel=0.01)
