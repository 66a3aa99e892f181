"""The cost of a sweep, measured before it is run and compared with a count by hand for its members."""

from __future__ import annotations

import pytest

from barbalat.budget import Budget
from barbalat.cases.load import CaseText
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.varied import VariedCase
from barbalat.sweeps.bounds import MOST_CERTIFIED, Bounds
from barbalat.sweeps.costs import Costs, require_members
from barbalat.sweeps.known_set_draws import sampled
from barbalat.sweeps.plan import Plan
from barbalat.sweeps.settling import Settling
from barbalat.sweeps.spread import Axis
from barbalat.sweeps.study import Study
from barbalat.validate import InputError

AT_THE_CLIENT = ("oscillated", "rings", "settled")
"""Columns that the client computes from the workers' results."""


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
    assert 8 * numbers <= costs.sent <= 8 * numbers + 200_000 / 4000  # the operation list, which a chunk has once
    names = [name for name in study.run(0, 1) if "/" in name and name.split("/")[1] not in AT_THE_CLIENT]
    assert 8 * len(names) <= costs.returned <= 8 * len(names) + 1
    assert 0 < costs.client < costs.worker and costs.stored > 8 * 5  # random numbers and errors cannot be compressed
    assert costs.tables == pytest.approx(24 * costs.steps, rel=0.01)


def test_members_that_share_no_kernel_are_dearer():
    """With a sampled command every member needs a separate run, but not with a grid of two commands. The same budget therefore
    allows fewer members."""
    head = CaseText.read("paper").text.split("[[controller]]")[0].replace("dt = 1e-4", "dt = 1e-2")
    text = CaseText(head + '[[controller]]\nname = "MRAC"\nscheme = "mrac"\ngamma = 0.1\n')

    def most(axes: dict[FieldPath, Axis], path: str) -> int:
        plan = Plan(axes, sampled(text, [(path, "uniform:1:1.5")]), 10**9)
        with Budget(memory=1e15), pytest.raises(InputError, match=r"^the sweep of \d+ members") as refused:
            require_members(Settling(Study(VariedCase(text, plan.paths), plan)), len(plan))
        return int(str(refused.value).split("at most ")[1].split()[0])

    amplitude = FieldPath.parse("reference.amplitude")
    together = most({}, "plant.theta[0]")
    assert most({}, "reference.amplitude") < together / 50
    assert together / 2 < most({amplitude: Axis(40.0, 50.0, 2)}, "plant.theta[0]") <= together


def test_the_certificates_of_bounds_count():
    """Members whose other numbers differ have one certificate each. If there are too many, none is computed, and they cost
    nothing."""
    text = CaseText.read("first-order")
    path = FieldPath.parse("plant.b[0]")

    def announced(members: int, *, bounds: bool) -> list[str]:
        said: list[str] = []
        plan = Plan({}, sampled(text, [(str(path), "uniform:1:1.5")]), members)
        study = Study(VariedCase(text, plan.paths), plan)
        with Budget(told=said.append):
            require_members(Settling(study), members, Bounds(study).certificates if bounds else 0)
        return said

    (said,) = announced(60, bounds=True)
    assert said.startswith("the sweep of 60 members: estimated at about ")
    assert announced(60, bounds=False) == [] and announced(MOST_CERTIFIED + 1, bounds=True) == []
