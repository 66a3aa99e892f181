"""The screen of ``barbalat certify``: five lines for each controller, or, in full, all values by kind and Table 1."""

from __future__ import annotations

from collections.abc import Mapping

from barbalat.certificates.cells import PROPERTIES, Column, counts_on_damping
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.certificates import Table1
from barbalat.certificates.entry import Entry
from barbalat.certificates.quantities import ON_DAMPING
from barbalat.certificates.rows import rows_of
from barbalat.certificates.summary import lines
from barbalat.pictures.symbols import held
from barbalat.report.terminal.layout import Screen

GROUPS = {
    "guaranteed": ("Guaranteed for this case", "green"),
    "guaranteed for the design": (
        "Guaranteed for the design: not for the simulated plant ([truth]), with faults, or after a rejected sample",
        "yellow",
    ),
    "exact": ("Exact for the named linear loop only", "green"),
    "estimate": ("Estimates, without a guarantee", ""),
    "searched": ("Smallest margins found over the known set or the parameters' ranges, without a guarantee", ""),
    "advice": ("For guidance", ""),
    "does not apply": ("Does not apply to this case", "red"),
}
"""The heading of each kind of values, in the order of display; searched values are grouped."""
STYLES = {"guaranteed": "green", "guaranteed for the design": "yellow", "exact": "green", "does not apply": "red"}
LABEL_COLUMNS = 10
"""Width in columns of the labels of the five lines, which is the length of the longest label."""
LEGEND = (
    "condition: what keeps all signals bounded. bound of e: one number for every component of e, each in its own unit. margin: "
    "the added delay that the linear loops tolerate at the case's theta, at the worst plant found in the known set or the "
    "parameters' ranges (frozen estimates then equal that plant's theta), and with the law linearised at the largest command "
    "(adapting). gain, step: estimated limits. The solver tolerates {} the first value even if all signals "
    "are at their largest, and oscillations begin near the second. dt: the case's step."
)
LONGEST_KEY, LONGEST_VALUE = 30, 14


def show(screen: Screen, case: str, certificates: Mapping[str, Certificate], table: Table1, dt: float | None) -> None:
    """Print five lines for each controller, with long reasons folded, and then the notes without duplicates."""
    screen.line(case, "bold")
    for column in table.columns:
        _controller(screen, column, certificates[column.name], dt)
    _notes(screen, certificates)
    screen.title(LEGEND.format(_how_sure(certificates)), "dim")


def _how_sure(certificates: Mapping[str, Certificate]) -> str:
    """Say how reliable the limits on gain and step are: "at least", or "about" if they rely on the damping of the loop."""
    found = [counts_on_damping(one, key) for one in certificates.values() for key in ON_DAMPING if key in one.values]
    if all(found):
        return "about" if found else "at least"
    return "at least (or about, if it relies on the damping of the loop)" if any(found) else "at least"


def _notes(screen: Screen, certificates: Mapping[str, Certificate]) -> None:
    owners: dict[str, list[str]] = {}
    for name, certificate in certificates.items():
        for note in certificate.notes:
            owners.setdefault(note, []).append(name)
    if owners:
        screen.title("Notes", "yellow")
    for note, names in owners.items():
        of = ", ".join(map(screen.name, names)) if len(names) < max(len(certificates), 2) else "all" if len(names) > 1 else ""
        screen.line(f"{of}: {note}" if of else note, indent="    ", start="  ")


def show_full(screen: Screen, case: str, certificates: Mapping[str, Certificate], table: Table1, dt: float | None) -> None:
    """Print the five lines, all values behind them, and Table 1."""
    screen.line(case, "bold")
    for column in table.columns:
        certificate = certificates[column.name]
        _controller(screen, column, certificate, dt)
        for note in certificate.notes:
            screen.fact("note", note, LABEL_COLUMNS, "yellow")
        _values(screen, certificate)
        if certificate.assumptions:
            screen.title("Assumptions", "")
            for sentence in certificate.assumptions:
                screen.line(f"- {sentence}", indent="  ")
    _table_1(screen, table)


def _controller(screen: Screen, column: Column, certificate: Certificate, dt: float | None) -> None:
    screen.title(_named(column))
    for line in lines(column, certificate, dt):
        screen.fact(line.label, line.text, LABEL_COLUMNS, STYLES.get(line.kind, ""))


def _named(column: Column) -> str:
    """Return name and scheme, or the scheme alone, spelled as in the name, if it begins with the name."""
    rest = column.scheme[len(column.name) :]
    if column.scheme.lower().startswith(column.name.lower()) and not rest[:1].isalnum():
        return f"{held(column.name)}{rest}"
    return f"{held(column.name)}: {column.scheme}"


def _values(screen: Screen, certificate: Certificate) -> None:
    for group, (title, style) in GROUPS.items():
        found = [row for entry in certificate.entries if _group(entry) == group for row in rows_of(entry)]
        if not found:
            continue
        screen.title(title, style)
        room = min(max(len(row.quantity) for row in found), LONGEST_KEY)
        width = min(max(len(row.value) for row in found), LONGEST_VALUE)
        for row in found:
            if row.value and row.meaning and len(row.value) <= width:
                screen.fact(row.quantity, f"{held(f'{row.value:{width}}')} {row.meaning}", room)
            else:
                for label, text in ((row.quantity, row.value), ("" if row.value else row.quantity, row.meaning)):
                    if text:
                        screen.fact(label, text, room)


def _group(entry: Entry) -> str:
    return "searched" if entry.key == "margins_over_known_set" and entry.applies else entry.kind


def _table_1(screen: Screen, table: Table1) -> None:
    screen.title("Table 1: guarantees")
    room = max(len(screen.name(column.name)) for column in table.columns)
    for key, title in PROPERTIES.items():
        screen.title(title, "")
        for column in table.columns:
            cell = column.cells[key]
            screen.fact(screen.name(column.name), f"{held(cell.kind)}: {cell.text}", room, STYLES.get(cell.kind, ""))
