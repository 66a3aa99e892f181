"""A tuning as rows of tables, for the page and for the terminal."""

from __future__ import annotations

from barbalat.comparison.plants import drawn_from
from barbalat.comparison.tune.result import Point, Tuned, Tuning
from barbalat.pictures.symbols import number_text
from barbalat.report.terminal.layout import Screen, grouped
from barbalat.sweeps.statistics import Share
from barbalat.validate import counted


def verdicts(found: Tuning) -> list[tuple[str, str, bool]]:
    """Return for each controller its name, one sentence on the chosen tuning, and whether it meets every constraint."""
    rows = []
    for name, one in found.controllers.items():
        point, meets = (one.nearest, False) if one.chosen is None else (one.chosen, True)
        reached = f"{found.aim.quantity.name} {number_text(_known(point.value))}"
        asked = "" if not found.aim.constraints else "; meets every constraint" if meets else "; no tuning meets every constraint"
        measured = one.delay_margin_measured
        tolerates = "" if measured is None else f"; tolerates {measured:.3g} s of delay as measured"
        rows.append((name, f"{one.verdict}; {reached}{asked}{tolerates}", meets))
    return rows


def points(found: Tuning) -> list[list[str]]:
    """Return rows with the controller, the kind of tuning, its parameters, the value of the objective, the values of the
    constraints, and whether it meets them."""
    rows = []
    for name, one in found.controllers.items():
        last = ("tuned", one.chosen) if one.chosen is not None else ("nearest", one.nearest)
        rows += [[name, what, *_point(found, point)] for what, point in (("as it was", one.start), last)]
    return rows


def columns(found: Tuning) -> tuple[str, ...]:
    """The headings of the table of ``points``."""
    return ("controller", "tuning", found.aim.quantity.name, *(one.quantity.name for one in found.aim.constraints), "meets all")


def numbers(point: Point) -> str:
    """The tuned fields of a point, each named by the last part of its path."""
    return ", ".join(f"{str(path).rsplit('.', 1)[-1]} {value:.4g}" for path, value in point.tuning.items())


def changes(one: Tuned) -> list[str]:
    """Return a line for each field of the chosen tuning: its path, its new value and its old value."""
    if one.chosen is None:
        return []
    before = one.start.tuning
    return [
        f"{path} = {value:.4g}" + (f", was {before[path]:.4g}" if path in before else "")
        for path, value in one.chosen.tuning.items()
    ]


def held_out(found: Tuning) -> list[list[str]]:
    """Return rows with the controller, the median and the worst value on validation plants, the worst plant, and the number of
    plants that violate each constraint.

    Beside each number is the Clopper-Pearson interval for the fraction of the known set, or of the parameter ranges.
    """
    rows = []
    for name, one in found.controllers.items():
        if one.held_out is None:
            continue
        new = one.held_out.as_json()
        broken = [_broken(Share(count=count, judged=new["plants"]), text) for text, count in new["broken"].items()]
        worst = one.held_out.worst_plant
        theta = f"theta [{', '.join(f'{value:.3g}' for value in worst.get('theta', ()))}]"
        values = ", ".join(f"{name} = {value:.4g}" for name, value in worst.get("parameters", {}).items())
        rows.append(
            [
                name,
                number_text(new["median"]),
                number_text(new["worst"]["value"]),
                values or theta,
                "; ".join(broken) or "none that a run can check",
            ]
        )
    return rows


HELD_OUT = ("controller", "median", "worst", "at", "constraints")
"""The headings of the table of ``held_out``."""


def _broken(share: Share, requirement: str) -> str:
    low, high = (100 * one for one in share.interval)
    said = f"{share.count} of {share.judged} violate {requirement}"
    return f"{said} ({low:.2g} to {high:.2g} % of all, with {100 * share.confidence:g} % confidence)"


def front(one: Tuned, found: Tuning) -> list[list[str]]:
    """Return rows with the parameters of each tuning on the front, the value of the objective and the value for the first
    constraint."""
    first = found.aim.constraints[0]
    return [
        [numbers(point), number_text(_known(point.value)), number_text(_known(point.found.get(first)))] for point in one.front
    ]


def judged(found: Tuning) -> str:
    """Return a phrase with the objective and the plants on which it is evaluated."""
    aim, count = found.aim, found.plants
    share = "the worst of" if aim.quantile == 1 else f"the {100 * aim.quantile:g} % quantile over"
    return (
        f"{'largest' if aim.maximize else 'smallest'} {aim.quantity.name}, {share} {count} plants"
        if count > 1
        else (f"{'largest' if aim.maximize else 'smallest'} {aim.quantity.name} on the plant of the case")
    )


def _point(found: Tuning, point: Point) -> list[str]:
    values = [number_text(_known(point.found.get(one))) for one in found.aim.constraints]
    return [number_text(_known(point.value)), *values, "yes" if point.meets else "no"]


def _known(value: float | None) -> float | None:
    return value if value is not None and abs(value) != float("inf") else None


def show(screen: Screen, found: Tuning) -> None:
    """Print a table, the changes and the results on validation plants."""
    screen.line(f"{found.case.name}: {judged(found)}", "bold")
    for name, sentence, meets in verdicts(found):
        screen.line(f"{screen.name(name)}: {sentence}", "green" if meets else "red", indent="    ", start="  ")
    for one in found.aim.constraints:
        screen.line(f"subject to {one.requirement}", start="  ")
    rows = [[screen.name(name), *cells] for name, *cells in points(found)]
    screen.table(columns(found), grouped(rows), leads=2)
    for name, tuned in found.controllers.items():
        screen.line("")
        screen.line(f"{name}: {counted(tuned.trials, 'tuning')}, {counted(tuned.runs, 'run')}")
        for change in changes(tuned):
            screen.whole(f"  {change}")
    rows = [[screen.name(name), *cells] for name, *cells in held_out(found)]
    if rows:
        screen.line("")
        count = next(len(one.held_out.values) for one in found.controllers.values() if one.held_out is not None)
        screen.line(f"On {counted(count, 'plant')} of {drawn_from(found.case.problem)} that were not used in the search:")
        screen.table(HELD_OUT, rows)
    for note in found.notes:
        screen.line(f"Note: {note}.", "yellow")
    screen.line(f"{found.seconds:.0f} s. Measured on these plants with this command; not a guarantee.")
