"""Tables on the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from barbalat.certificates.cells import PROPERTIES
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.table_1 import Table as Table1
from barbalat.claims.claim import Claim, PaperFigure
from barbalat.report.certificates import rows
from barbalat.report.numbers import number_text
from barbalat.run.result import Result

STYLES = {"confirmed": "green", "confirmed with conditions": "yellow", "not confirmed": "red", "erratum": "red"}
KINDS = {"guaranteed": "green", "exact": "green", "does not apply": "red", "estimate": "dim", "advice": "dim"}


def figures_of_runs(results: Sequence[Result]) -> Table:
    """One row for each controller."""
    table = Table(title="Figures over every solver step", caption="tail: the last quarter of the run", pad_edge=False)
    for heading in (
        "controller",
        "max |e|",
        "RMS e",
        "max |e| in the tail",
        "max |u|",
        "estimates at the end",
        "their variation, 1/s",
        "h|λ|",
    ):
        table.add_column(heading, overflow="fold")
    for result in results:
        if result.diverged_at is not None:
            table.add_row(
                escape(result.name),
                f"[red]diverged at t = {result.diverged_at:.6g} s[/red]",
                *[""] * 5,
                f"{result.stiffness.h_lambda_max:.3g}",
            )
            continue
        f = result.figures
        names = ("max_abs_e", "rms_e", "tail_max_abs_e", "max_abs_u", "theta_hat_final", "theta_hat_variation_rate")
        table.add_row(
            escape(result.name),
            *(number_text(f[name], "\n") for name in names),
            f"{result.stiffness.h_lambda_max:.3g}",
            end_section=True,
        )
    return table


def adapting_of_runs(results: Sequence[Result]) -> Table:
    """One row for each controller that estimates: is it adapting?"""
    table = Table(title="Is it adapting?", caption="path: the sum of every step's change", pad_edge=False)
    for heading in ("controller", "moved, net", "path", "path in the tail", "on its bounds", "excitation"):
        table.add_column(heading, overflow="fold")
    for result in results:
        if result.adapting is not None:
            found = result.adapting
            moved = (number_text(value.tolist(), "\n") for value in (found.net, found.path, found.tail_path))
            table.add_row(escape(result.name), *moved, found.on_bounds_text, found.excitation_text, end_section=True)
    return table


def checks_of_figures(figures: Sequence[PaperFigure]) -> Table:
    """What each figure's description says, and what was measured."""
    table = Table(title="Figures of Section V", pad_edge=False, show_lines=False)
    for heading in ("figure", "the description says", "", "measured"):
        table.add_column(heading, overflow="fold")
    for figure in figures:
        for i, check in enumerate(figure.checks):
            mark = "[green]yes[/green]" if check.holds else "[red]no[/red]"
            table.add_row(
                figure.key if i == 0 else "", check.statement, mark, check.measured, end_section=i == len(figure.checks) - 1
            )
    return table


def ledger(claims: Sequence[Claim]) -> Table:
    """The claims with their verdicts."""
    table = Table(title="Claims", pad_edge=False)
    for heading in ("claim", "statement", "verdict", "measured"):
        table.add_column(heading, overflow="fold")
    for claim in claims:
        table.add_row(
            claim.id, f"{claim.statement} ({claim.where})", f"[{STYLES[claim.verdict]}]{claim.verdict}[/]", claim.measured
        )
    return table


def certificate(name: str, found: Certificate) -> Table:
    """One controller's certificate: what is a guaranteed bound, what an estimate."""
    table = Table(title=escape(name), title_justify="left", pad_edge=False)
    for heading in ("quantity", "value", "", "meaning"):
        table.add_column(heading, overflow="fold")
    for row in rows(found):
        table.add_row(escape(row.quantity), escape(row.value), row.kind, escape(row.meaning))
    return table


def table_1(found: Table1) -> Table:
    """What is guaranteed of each controller's scheme."""
    table = Table(title="Table 1: what is guaranteed", show_lines=True, pad_edge=False)
    table.add_column("")
    for column in found.columns:
        table.add_column(escape(f"{column.name}\n{column.scheme}"), overflow="fold")
    for key, title in PROPERTIES.items():
        cells = (column.cells[key] for column in found.columns)
        table.add_row(title, *(f"[{KINDS[cell.kind]}]{cell.kind}:[/] {escape(cell.text)}" for cell in cells))
    return table


def tradeoff(rows: Sequence[tuple[str, ...]], schemes: Sequence[str]) -> Table:
    """The delays borne at equal error, by both criteria."""
    table = Table(
        title=escape("Delay borne [s] on the case's own plant, with an RMS |e| / RMS |x_m| of at most ..."), pad_edge=False
    )
    for heading in ("error", *(f"{name}: {scheme}" for name in ("onset", "loss") for scheme in schemes)):
        table.add_column(heading, overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def console(*, to_standard_error: bool = False) -> Console:
    """Where tables go, or notes and progress with ``to_standard_error``."""
    return Console(stderr=to_standard_error, highlight=False)
