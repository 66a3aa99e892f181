"""What ``barbalat certify`` shows: five lines for each controller; in full every value by its kind, and Table 1."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from barbalat.certificates.cells import PROPERTIES, Column
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.entry import Entry
from barbalat.certificates.rounding import up
from barbalat.certificates.table_1 import Table
from barbalat.report.certificates import Row, rows
from barbalat.report.terminal.layout import Screen, held, name

KINDS = {
    "guaranteed": ("Guaranteed on this case", "green"),
    "linear loop": ("Exact for the linear loop named, and for nothing else", "green"),
    "estimate": ("Estimates, without a guarantee", ""),
    "": ("For orientation", ""),
    "does not apply": ("Does not apply on this case", "red"),
}
"""How what is printed of a kind is headed, in the order in which it is shown."""
STYLES = {"guaranteed": "green", "exact": "green", "does not apply": "red"}
ROOM = 11
"""Columns of the five lines' labels."""
LONGEST_KEY, LONGEST_VALUE = 30, 14


class Line(NamedTuple):
    """One of the five: what it is about, what is said, and how sure that is."""

    label: str
    text: str
    kind: str


def show(screen: Screen, case: str, certificates: Mapping[str, Certificate], table: Table, dt: float | None) -> None:
    """Five lines for each controller."""
    screen.line(case, "bold")
    for column in table.columns:
        _controller(screen, column, certificates[column.name], dt)


def show_full(screen: Screen, case: str, certificates: Mapping[str, Certificate], table: Table, dt: float | None) -> None:
    """The five lines and everything behind them, then Table 1."""
    screen.line(case, "bold")
    for column in table.columns:
        certificate = certificates[column.name]
        _controller(screen, column, certificate, dt)
        _values(screen, rows(certificate))
        if certificate.assumptions:
            screen.title("Assumed of the above", "")
            for sentence in certificate.assumptions:
                screen.line(f"- {sentence}", indent="  ")
    _table_1(screen, table)


def _controller(screen: Screen, column: Column, certificate: Certificate, dt: float | None) -> None:
    screen.title(f"{name(column.name)}: {column.scheme}")
    for line in five(column, certificate, dt):
        screen.fact(line.label, line.text, ROOM, STYLES.get(line.kind, ""))
    for note in certificate.notes:
        screen.fact("note", note, ROOM, "yellow")


def five(column: Column, certificate: Certificate, dt: float | None) -> tuple[Line, ...]:
    """Does the condition hold; the bound; the margin; the largest gain and step; what is assumed, and what of it fails."""
    return (
        _condition(column.cells.get("stability"), certificate.entry("condition")),
        _bound(certificate),
        _margin(certificate),
        _limits(certificate, dt),
        _assumed(certificate),
    )


def _condition(stability: Entry | None, condition: Entry | None) -> Line:
    if condition is not None and condition.value is not None:
        value = condition.value
        of = f"||{value.get('of', 'W_b (1 - C)')}||_1 {value.get('times', 'theta_max')}"
        size = "is infinite" if value["value_upper"] is None else f"<= {up(value['value_upper'])}"
        if value["holds"]:
            return Line("condition", f"holds: {of} {size} < 1", condition.kind)
        return Line("condition", f"not shown to hold: {of} {size}, and 1 is needed", "does not apply")
    if stability is None or not stability.applies:
        reason = "nothing is known" if stability is None else stability.why
        return Line("condition", f"boundedness is not shown: {reason}", "does not apply")
    return Line("condition", f"none is needed: signals are bounded {stability.text}", stability.kind)


def _bound(certificate: Certificate) -> Line:
    bound, worst = certificate.entry("error_bound"), certificate.entry("error_bound_worst")
    if bound is None or not bound.applies or bound.value is None:
        reason = "no bound of e is known for this scheme" if bound is None or not bound.why else bound.why
        return Line("bound", f"none: {reason}", "does not apply")
    text = f"|e| <= {up(bound.value)} in every component"
    if worst is not None and worst.applies and worst.value is not None:
        text += f"; {up(worst.value)} for any theta of the known set"
    return Line("bound", f"{text} ({bound.kind})", bound.kind)


def _margin(certificate: Certificate) -> Line:
    margin, adapting = certificate.entry("delay_margin"), certificate.entry("delay_margin_adapting")
    parts = []
    if margin is not None and margin.applies:
        parts.append(f"{_delay(margin.value)} {margin.of}")
    over_set = certificate.entry("margins_over_known_set")
    for loop in () if over_set is None or not over_set.applies else over_set.value:
        if "unstable_at" in loop:
            parts.append(f"unstable somewhere in the known set ({loop['loop']})")
        elif "delay_margin" in loop:
            parts.append(f"{_delay(loop['delay_margin']['value'])} at the least found over the known set ({loop['loop']})")
    if adapting is not None and adapting.applies:
        parts.append(f"{_delay(adapting.value)} {adapting.of}")
    if not parts:
        return Line("delay", "no margin is known: no linear loop describes it", "does not apply")
    return Line("delay", "; ".join(parts), margin.kind if margin is not None and len(parts) == 1 else "estimate")


def _delay(value: float | None) -> str:
    return "any" if value is None else held(f"{value:.3g} s")


def _limits(certificate: Certificate, dt: float | None) -> Line:
    gain, step = certificate.values.get("gamma_max"), certificate.values.get("step_max")
    parts = [] if gain is None else [f"the step bears a gain up to {gain:.3g}"]
    if step is not None:
        judged = "" if dt is None else f": the case's {dt:g} s is {'inside' if dt <= step else 'too long'}"
        parts.append(f"the gain bears a step up to {step:.3g} s{judged}")
    text = "; ".join(parts)
    return Line("gain, step", f"{text} (estimate)" if parts else "no limit is known", "estimate")


def _assumed(certificate: Certificate) -> Line:
    count = len(certificate.assumptions)
    broken = dict.fromkeys(e.why for e in certificate.entries if not e.applies and e.assumptions)
    checked = (
        f"{count} {'assumption' if count == 1 else 'assumptions'} behind the values above" if count else "nothing is claimed"
    )
    if broken:
        return Line("assumed", f"{checked}; of others this case breaks: {', '.join(broken)}", "does not apply")
    return Line("assumed", f"{checked}; this case breaks none", "guaranteed" if count else "")


def _values(screen: Screen, found: list[Row]) -> None:
    for kind, (title, style) in KINDS.items():
        mine = [row for row in found if row.kind == kind]
        if not mine:
            continue
        screen.title(title, style)
        room = min(max(len(row.quantity) for row in mine), LONGEST_KEY)
        width = min(max((len(row.value) for row in mine), default=0), LONGEST_VALUE)
        for row in mine:
            text = f"{held(row.value):{width}}".replace(" ", "\N{NO-BREAK SPACE}") if len(row.value) <= width else row.value
            screen.fact(row.quantity, f"{text}  {row.meaning}".strip() if row.meaning else text.strip(), room)


def _table_1(screen: Screen, table: Table) -> None:
    screen.title("Table 1: what is guaranteed")
    room = max(len(name(column.name)) for column in table.columns)
    for key, title in PROPERTIES.items():
        screen.title(title, "")
        for column in table.columns:
            cell = column.cells[key]
            screen.fact(name(column.name), f"{held(cell.kind)}: {cell.text}", room, STYLES.get(cell.kind, ""))
