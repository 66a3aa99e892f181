"""The table of a suite, for its page and for the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from barbalat.comparison.suite.suite import Standings
from barbalat.report.terminal.layout import Screen, capitalized

COLUMNS = ("case", "entry", "settings", "rule", "specification", "failed", "median error", "delay [s]", "gain")


def identity(found: Standings) -> str:
    """Which suite it is, with its hash."""
    kind = "the public suite" if found.suite.is_public else "another suite, not the public one:"
    return f"{kind} {found.suite.name}, SHA-256 {found.suite.sha256}"


def rebuilt(found: Standings) -> str:
    """How the measured rows compare with the stored ones, in a sentence."""
    agree, differ = found.compared["agree"], found.compared["differ"]
    if not agree and not differ:
        return "none of the measured rows is stored"
    said = f"{len(agree)} of {len(agree) + len(differ)} measured rows agree with the stored ones to nine digits"
    said += f", {len(found.compared['in_every_bit'])} in every bit"
    return f"{said}; others: {', '.join(differ)}" if differ else said


def rows(given: Iterable[Mapping[str, Any]]) -> list[list[str]]:
    """The rows as a table has them."""
    return [
        [
            row["case"], row["entry"], row["settings"], _yes(row["meets_rule"]), _yes(row["meets_specification"]),
            "-" if row["runs"] is None else f"{row['failed']} of {row['runs']}",
            "-" if row["median_error"] is None else f"{row['median_error']:.3g}",
            f"{row['delay_margin_measured']:.3g}", f"{row['gain_margin_measured']:.3g}",
        ]
        for row in given
    ]  # fmt: skip


def _yes(holds: bool) -> str:
    return "meets it" if holds else "no"


def show(screen: Screen, found: Standings) -> None:
    """Which suite, the rows that were measured, those that are stored beside them, and whether they agree."""
    screen.line(f"{capitalized(identity(found))}.")
    screen.table(COLUMNS, rows(found.rows), leads=2)
    if found.beside:
        screen.title("Beside them, stored")
        screen.table(COLUMNS, rows(found.beside), leads=2)
    screen.line(f"{capitalized(rebuilt(found))}.")
