"""Derivatives of metrics in words and numbers."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from barbalat.gradients.check import NEGLIGIBLE
from barbalat.gradients.sensitivity import Derivative, Sensitivities
from barbalat.open_numbers.path import by_label
from barbalat.pictures.symbols import number_text
from barbalat.problem.labels import Labels
from barbalat.report.terminal.layout import Screen
from barbalat.validate import counted

MOST_ROWS = 12
"""How many numbers a screen lists for each controller; the others are in the JSON document."""
REFUSED = "rejected"


def show(screen: Screen, found: Sensitivities, labels: Labels | None, *, named: bool) -> None:
    """Print a table for each controller, the numbers with the largest elasticities first, and the reasons for rejections.

    named  whether the numbers were chosen by name; if not, definitions are only listed
    """
    screen.line(f"{found.case}: percent change of a metric per percent change of a parameter", "bold")
    if not found.redesign:
        screen.line(
            "Changes of the plant and its parameters affect only the simulated plant: the controllers stay as designed (unless "
            "--redesign is given).", start="  ", indent="  ",
        )  # fmt: skip
    for name in found.controllers:
        own = [one for one in found.derivatives if one.controller == name]
        figures = list(dict.fromkeys(one.figure for one in own))
        screen.title(screen.name(name))
        for figure in figures:
            value = next(one for one in own if one.figure == figure)
            when = "" if value.instant is None else f", at t = {value.instant:.4g} s"
            at = "-" if value.at is None else number_text(value.at)
            screen.line(f"{by_label(figure, labels)} = {at}{when}", start="  ", indent="    ")
        if all(one.at is None for one in own):
            screen.line("The run diverges, so its metrics have no derivatives.", "yellow", start="  ")
            continue
        if all(one.refused for one in own):
            screen.line("All derivatives are rejected.", start="  ")
            _reasons(screen, own, labels)
            continue
        ranked = _ranked([one for one in own if named or not one.definition])
        lead = ranked[:MOST_ROWS]
        if len(figures) == 1:
            rows = [_alone(path, by[figures[0]]) for path, by in lead]
            screen.table(("number", "value", "elasticity", "derivative", "by differences"), rows)
        else:
            headings = ("number", "value", *(by_label(one, labels).replace("[", "\n[") for one in figures))
            screen.table(headings, [_row(path, by, figures) for path, by in lead])
        if len(ranked) > len(lead):
            rest = counted(len(ranked) - len(lead), "further number")
            screen.line(f"With less influence, listed in the output of --json: {rest}.", start="  ")
        if defining := [] if named else list(dict.fromkeys(str(one.path) for one in own if one.definition)):
            screen.line(
                f"Numbers that only define a rate or the form of a transfer function (shown by --json and --to): "
                f"{', '.join(defining)}.", start="  ", indent="    ",
            )  # fmt: skip
        if any(one.local for one in own):
            screen.line(
                "* valid only for changes well below 0.1 %: the slope over a change of 0.1 % differs by more than a tenth.",
                "yellow", start="  ", indent="  ",
            )  # fmt: skip
        _reasons(screen, own, labels)
    for why in dict.fromkeys(found.without.values()):
        which = [path for path, other in found.without.items() if other == why]
        screen.line(f"No derivative with respect to {', '.join(which)}: {why}.", "yellow", "    ", "  ")
    if found.steps is not None:
        screen.line(f"{found.steps[0].upper()}{found.steps[1:]}.")
    total = sum(found.seconds.values())
    screen.line(
        f"Derivatives of the discrete runs, computed with tangents and compared with differences of {found.runs} further runs; "
        f"{total:.2g} s in all."
    )


def _ranked(own: Sequence[Derivative]) -> list[tuple[str, dict[str, Derivative]]]:
    """The derivatives by path and metric, the paths with the largest elasticity first; for a rejected derivative, the elasticity
    by differences."""
    by_path: dict[str, dict[str, Derivative]] = {}
    for one in own:
        by_path.setdefault(str(one.path), {})[one.figure] = one

    def largest(item: tuple[str, dict[str, Derivative]]) -> float:
        return max(map(_size, item[1].values()))

    return sorted(by_path.items(), key=largest, reverse=True)


def _size(one: Derivative) -> float:
    """The size of the elasticity, or of its estimate by differences; infinite if a run with a neighbouring value diverges, and -1
    if there is no elasticity."""
    if one.elasticity is not None:
        return abs(one.elasticity)
    if one.refused and one.difference is None:
        return inf
    return abs(one.difference * one.value / one.at) if one.difference is not None and one.at else -1.0


def _row(path: str, by: dict[str, Derivative], figures: Sequence[str]) -> tuple[str, ...]:
    return path, number_text(next(iter(by.values())).value), *(_elasticity(by[figure]) for figure in figures)


def _alone(path: str, one: Derivative) -> tuple[str, ...]:
    derivative = REFUSED if one.derivative is None else f"{one.derivative:.4g}"
    return path, number_text(one.value), _elasticity(one), derivative, "-" if one.difference is None else f"{one.difference:.4g}"


def _elasticity(one: Derivative) -> str:
    if one.refused:
        return REFUSED
    if one.elasticity is None:
        return "-"
    return "0" if abs(one.elasticity) < NEGLIGIBLE else f"{one.elasticity:.3g}{'*' if one.local else ''}"


def _reasons(screen: Screen, own: Sequence[Derivative], labels: Labels | None) -> None:
    for sentence in _refusals(own, labels):
        screen.line(sentence, "yellow", "    ", "  ")


def _refusals(own: Sequence[Derivative], labels: Labels | None) -> list[str]:
    """Sentences on rejected derivatives: how many have the same reason, or the first few individually."""
    refused = [one for one in own if one.refused]
    found = []
    for why in dict.fromkeys(one.refused for one in refused):
        same = [one for one in refused if one.refused == why]
        which = f"{by_label(same[0].figure, labels)} with respect to {same[0].path}"
        more = f" and {len(same) - 1} more" if len(same) > 1 else ""
        found.append(f"Rejected: {which}{more}. Reason: {why}.")
    kept = found[:MOST_REASONS]
    return kept + ([f"{len(found) - len(kept)} further reasons are in the output of --json."] if len(found) > len(kept) else [])


MOST_REASONS = 6
"""How many rejections a screen explains for each controller."""
