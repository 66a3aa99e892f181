"""Tables on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from barbalat.certify.certificate import Certificate
from barbalat.claims.claim import Claim, PaperFigure
from barbalat.result import Result

STYLES = {"confirmed": "green", "confirmed with conditions": "yellow", "not confirmed": "red", "erratum": "red", "pending": "dim"}


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
                result.name,
                f"[red]diverged at t = {result.diverged_at:.6g} s[/red]",
                *[""] * 5,
                f"{result.stiffness.h_lambda_max:.3g}",
            )
            continue
        f = result.figures
        names = ("max_abs_e", "rms_e", "tail_max_abs_e", "max_abs_u", "theta_hat_final", "theta_hat_variation_rate")
        table.add_row(
            result.name, *(number_text(f[name], "\n") for name in names), f"{result.stiffness.h_lambda_max:.3g}", end_section=True
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
            table.add_row(result.name, *moved, found.on_bounds_text, found.excitation_text, end_section=True)
    return table


def number_text(value: float | list[float] | None, separator: str = ", ") -> str:
    """A figure for people: four digits, components with a separator between."""
    if isinstance(value, list):
        return separator.join(number_text(v) for v in value) or "-"
    return "-" if value is None else f"{value:.4g}"


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
    table = Table(title=name, title_justify="left", pad_edge=False)
    for heading in ("quantity", "value", ""):
        table.add_column(heading, overflow="fold")
    for key, value in found.values.items():
        if value is None:
            continue
        kind = "guaranteed" if key in found.guaranteed else ""
        if key == "norms":
            for norm, ends in value.items():
                table.add_row(f"L1 norm of {norm}", f"{ends['lower']:.10g} ... {ends['upper']:.10g}", kind)
        elif key == "condition":
            verdict = "[green]holds[/green]" if value["holds"] else "[red]not shown to hold[/red]"
            name = f"||{value.get('of', 'W_b (1 - C)')}||_1 {value.get('times', 'theta_max')} < 1"
            table.add_row(name, f"{number_text(value['value_upper'])}: {verdict}", kind)
        elif key == "margins_over_known_set":
            for entry in value:
                _worst_case(table, entry)
        elif key == "unlimited":
            table.add_row(key, ", ".join(value), kind)
        else:
            table.add_row(
                key, f"{value:.6g}" if isinstance(value, float) else value if isinstance(value, str) else number_text(value), kind
            )
    return table


def _worst_case(table: Table, entry: dict[str, Any]) -> None:
    """Rows for the margins of one linear loop over the known set."""
    table.add_row("over the known set", f"{entry['of']}; searched: {entry['searched']}", "")
    for key, value in entry.items():
        if isinstance(value, dict):
            table.add_row(f"  {key}", f"{value['value']:.6g} at theta = [{number_text(value['theta'])}]", "")
    if entry["unlimited"]:
        table.add_row("  unlimited", ", ".join(entry["unlimited"]), "")
    if "unstable_at" in entry:
        table.add_row("  unstable at", f"theta = [{number_text(entry['unstable_at'])}]", "")


def console(*, to_standard_error: bool = False) -> Console:
    """Where tables go, or notes and progress with ``to_standard_error``."""
    return Console(stderr=to_standard_error, highlight=False)
