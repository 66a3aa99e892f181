"""The least and the largest values found by a search over a set, in words and numbers."""

from __future__ import annotations

from barbalat.open_numbers.path import by_label
from barbalat.pictures.symbols import number_text
from barbalat.problem.labels import Labels
from barbalat.report.terminal.layout import Screen, grouped
from barbalat.sweeps.worst import NO_PROOF, Extremes, Member, WorstFound

RESOLVED_WITHIN = 0.01
"""Relative difference from the value with half the step, below which the step is said to resolve the run."""


def show(screen: Screen, found: WorstFound, labels: Labels | None) -> None:
    """Print a table of the extremes of each controller, with the members at which they occur, and the guaranteed bounds."""
    screen.line(f"{found.case}: {NO_PROOF}", "bold")
    for path, (low, high) in found.ranges.items():
        screen.line(f"{path} from {low:g} to {high:g}", start="  ", indent="    ")
    paths = list(found.ranges)
    rows = []
    for one in found.extremes:
        for what, member in (("largest", one.largest), ("least", one.least)):
            rows.append((one.controller, by_label(one.figure, labels), what, _value(member), *_numbers(member, paths)))
    screen.title("Extremes", "")
    screen.table(("controller", "figure", "", "value", *paths), grouped(rows), leads=3)
    for one in found.extremes:
        for sentence in _sentences(one, labels):
            screen.line(sentence, start="  ", indent="    ")
    if found.steps is not None:
        screen.line(f"{found.steps[0].upper()}{found.steps[1:]}.")
    undefined = f"; {found.undefined} gradients do not exist or overflow" if found.undefined else ""
    screen.line(
        f"Found by {found.runs} runs and {found.gradients} gradients from many starting points and the vertices{undefined}."
    )


def _value(member: Member) -> str:
    return "diverges" if member.value is None else number_text(member.value)


def _numbers(member: Member, paths: list[str]) -> list[str]:
    return [number_text(member.numbers[path]) for path in paths]


def _sentences(one: Extremes, labels: Labels | None) -> list[str]:
    """The comparison with the guaranteed bound, and a warning where half the step gives a different value."""
    name, found = f"{one.controller}, {by_label(one.figure, labels)}", []
    if one.bound is not None and one.largest.value is not None:
        share = 100 * one.largest.value / one.bound
        found.append(f"{name}: the largest is {share:.3g} % of the guaranteed bound, {one.bound:.4g}.")
    if one.largest.value == one.least.value is not None:
        found.append(f"{name} does not depend on these numbers.")
    for member in (one.largest, one.least):
        value, half = member.value, member.half_step
        if value is not None and (half is None or abs(half - value) > RESOLVED_WITHIN * abs(value)):
            said = "the run diverges" if half is None else f"it is {half:.4g}"
            found.append(f"{name} = {value:.4g}: with half the step {said}; the step does not resolve this member.")
    return found
