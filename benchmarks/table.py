"""Rows of ratios and how they are printed."""

from __future__ import annotations

from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

console = Console(width=150)


@dataclass(frozen=True)
class Row:
    """One comparison. ``ratio`` is the peer's time divided by the package's; ``at_least`` or ``at_most`` is its target."""

    what: str
    ours: str
    peer: str
    ratio: float
    at_least: float | None = None
    at_most: float | None = None

    @property
    def target(self) -> str:
        if self.at_least is not None:
            return f">= {self.at_least:g}"
        return f"<= {self.at_most:g}" if self.at_most is not None else ""

    @property
    def met(self) -> str:
        if self.at_least is None and self.at_most is None:
            return ""
        good = self.ratio >= self.at_least if self.at_least is not None else self.ratio <= (self.at_most or 0.0)
        return "yes" if good else "NO"


def show(title: str, rows: list[Row], notes: list[str]) -> None:
    if not rows:
        console.print(title, style="bold")
    table = Table(title=title, title_justify="left", title_style="bold", pad_edge=False)
    for name in ("what", "ours", "peer"):
        table.add_column(name)
    for name in ("ratio", "target", "met"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(row.what, row.ours, row.peer, f"{row.ratio:.3g}", row.target, row.met)
    if rows:
        console.print(table)
    for note in notes:
        console.print(f"  {note}", highlight=False)
    console.print()
