"""Lessons without a browser: their goals by the simulator. ``browser_lessons.py`` checks them on the page."""

from __future__ import annotations

import pytest

from barbalat import simulate
from barbalat.explorer.describe import Described
from barbalat.explorer.lessons import BoundedGoal, FigureGoal, SettingGoal
from barbalat.explorer.section_v import PAGES, addresses, explorer
from barbalat.open_numbers.path import FieldPath
from barbalat.papers.jafari_2013.paper import PAPER
from papers.a_claim import a_claim

LESSONS = [(file, lesson) for file, lessons in PAGES.items() for lesson in lessons]


def figures_of(file, lesson, numbers):
    """The metrics of the lesson's controllers by name, without fused multiply-adds."""
    source = explorer(file).source
    names = [controller.name for controller in source.at({}).controllers]
    toggled = [names.index(name) for name, on in lesson.projection.items() if on != source.projected(names.index(name))]
    case = source.at({FieldPath.parse(path): value for path, value in numbers.items()}, toggled)
    shown = [controller for controller in case.controllers if controller.name in lesson.shown]
    return {name: run.figures for name, run in simulate(case.problem, shown, case.simulation).items()}


def holds(goal, numbers, found, started) -> bool:
    if isinstance(goal, BoundedGoal):
        return found[goal.controller]["diverged_at"] is None
    if isinstance(goal, SettingGoal):
        value = numbers.get(goal.path)
        return value is None or (value <= goal.value if goal.relation == "<=" else value >= goal.value)
    if not isinstance(goal, FigureGoal):
        return True  # the setting keeps projection off
    other = {None: None, "start": started.get(goal.controller)}.get(goal.share_of, found.get(goal.share_of))
    value = found[goal.controller][goal.figure]
    if None in value:
        return False
    wanted = goal.value * (1.0 if other is None else max(other[goal.figure]))
    return max(value) < wanted if goal.relation == "<" else max(value) > wanted


@pytest.mark.full
@pytest.mark.parametrize(("file", "lesson"), LESSONS, ids=lambda part: getattr(part, "key", ""))
def test_a_goal_is_open_at_the_beginning_and_reached_by_the_example(file, lesson) -> None:
    numbers = lesson.numbers | lesson.example
    started, found = figures_of(file, lesson, lesson.numbers), figures_of(file, lesson, numbers)
    beginning = {"simulation.dt": explorer(file).source.at({}).simulation.dt} | lesson.numbers
    assert not all(holds(goal, beginning, started, started) for goal in lesson.checks)
    assert all(holds(goal, numbers, found, started) for goal in lesson.checks)


@pytest.mark.full
@pytest.mark.parametrize("file", PAGES)
def test_a_lesson_moves_sliders_of_its_page_to_values_that_they_take(file) -> None:
    sliders = {str(one.number.path): one for one in Described.of(explorer(file).source).sliders}
    for lesson in PAGES[file]:
        for path, value in (lesson.numbers | lesson.example).items():
            assert path in sliders or path in ("simulation.dt", "plant.input.delay")
            assert path not in sliders or sliders[path].copied or value in sliders[path].number.values


def test_the_claims_of_lessons_are_rows_of_the_ledger() -> None:
    names = {name for part in PAPER.ledger for name in part.names}
    assert {claim for _, lesson in LESSONS for claim in lesson.claims} <= names


def test_a_finding_is_told_only_where_it_was_measured() -> None:
    claim = a_claim("tau-error", False, statement="<b>a statement</b>")
    (lesson,) = [lesson for _, lesson in LESSONS if lesson.key == "figure-2"]
    told = {one["id"]: one for one in lesson.as_data(("Robust MRAC", "L1", "MRAC"), [claim])["claims"]}
    assert told["figures-2-5"] == {
        "id": "figures-2-5", "statement": "Figures 2 to 5 look as their captions and the text describe them",
    }  # fmt: skip
    assert (told["tau-error"]["finding"], told["tau-error"]["headline"]) == ("fails", "It is 7.")
    assert addresses([claim])["tau-error"] == "explorer.html#lesson=figure-2"
    assert "boundary" not in addresses([claim])
