"""The table of a suite, for its page and for the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from barbalat.comparison.suite.suite import Standings
from barbalat.report.terminal.layout import Screen, capitalized

COLUMNS = ("case", "entry", "settings", "rule", "specification", "failed", "median error", "delay [s]", "gain", "at an end")
PAGE_COLUMNS = (*COLUMNS[:-1], "tuning; * at an end of its range")


def identity(found: Standings) -> str:
    """Return a phrase that identifies the suite, with its hash."""
    kind = "the public suite" if found.suite.is_public else "a suite other than the public one:"
    return f"{kind} {found.suite.name}, SHA-256 {found.suite.sha256}"


def rebuilt(found: Standings) -> str:
    """Return a sentence that compares the measured rows with the stored rows."""
    agree, differ = found.compared["agree"], found.compared["differ"]
    if not agree and not differ:
        return "none of the measured rows is stored"
    said = f"{len(agree)} of {len(agree) + len(differ)} measured rows agree with the stored ones to nine digits"
    said += f", {len(found.compared['in_every_bit'])} of them bit for bit"
    return f"{said}; the others are {', '.join(differ)}" if differ else said


def rows(given: Iterable[Mapping[str, Any]]) -> list[list[str]]:
    """Return the rows of the table for the terminal."""
    return [
        [
            row["case"], row["entry"], row["settings"], _yes(row["meets_rule"]), _yes(row["meets_specification"]),
            "-" if row["runs"] is None else f"{row['failed']} of {row['runs']}",
            "-" if row["median_error"] is None else f"{row['median_error']:.3g}",
            f"{row['delay_margin_measured']:.3g}", f"{row['gain_margin_measured']:.3g}", ", ".join(row["at_edge"]) or "-",
        ]
        for row in given
    ]  # fmt: skip


def page_rows(given: Iterable[Mapping[str, Any]]) -> list[list[str]]:
    """Return the rows of the table for the page, which include the tunings."""
    every = list(given)
    return [[*cells[:-1], _tuning(row)] for row, cells in zip(every, rows(every), strict=True)]


def without(stored: Mapping[str, Any]) -> list[str]:
    """Return, for each case of the stored table, a sentence on its missing entries, grouped by reason."""
    return [
        f"{case} does not include {'; '.join(group['entries'])}: each {group['reason']}"
        for case, groups in stored["left_out"].items()
        for group in groups
    ]


def _tuning(row: Mapping[str, Any]) -> str:
    """The parameters keyed by name. A value at an end of its range is marked."""
    return ", ".join(f"{name} {value:.3g}{'*' if name in row['at_edge'] else ''}" for name, value in row["tuning"].items()) or "-"


def _yes(holds: bool) -> str:
    return "meets it" if holds else "no"


def show(screen: Screen, found: Standings) -> None:
    """Print the suite's identity, the measured rows, the stored rows, and whether they agree."""
    screen.line(f"{capitalized(identity(found))}.")
    screen.table(COLUMNS, rows(found.rows), leads=2)
    for name in found.empty:
        screen.line(f"{name}: no scheme takes part; {'; '.join(found.left_out[name])}.")
    if found.stored_only:
        screen.title("Stored rows")
        screen.table(COLUMNS, rows(found.stored_only), leads=2)
    screen.line(f"{capitalized(rebuilt(found))}.")
