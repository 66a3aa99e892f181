"""Explorers of a sweep's worst members. Each contains one controller, with the member's numbers in place of the case's."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from barbalat.cases.load import CaseText
from barbalat.explorer.explorer import Explorer
from barbalat.explorer.source import TextSource, toml
from barbalat.open_numbers.varied import VariedCase
from barbalat.report.file_names import file_name
from barbalat.report.sweep import WorstMember
from barbalat.sweeps.result import SweepResult
from barbalat.validate import InputError

MOST_PAGES = 6
"""Largest number of pages. Each takes one second and 0.2 MB."""


@dataclass(frozen=True, eq=False)
class Explored:
    """A worst member with its page. The page is None if it cannot be made; the row gives the reason."""

    row: WorstMember
    page: str | None


def explored(text: CaseText, found: SweepResult) -> Iterator[Explored]:
    """Yield, for each controller, the member that diverged first or, if none diverged, the member with the largest error."""
    for i, name in enumerate(found.controllers[:MOST_PAGES]):
        judged = [figure for figure in ("diverged_at", "max_abs_e[0]") if name in found.evidence.metrics.get(figure, {})]
        if not judged:
            continue
        member = found.evidence.metrics[judged[0]][name].worst_member
        row = WorstMember(controller=name, figure=judged[0], member=member)
        try:
            page = Explorer(TextSource(_alone(text, found, i, member))).html
        except InputError as error:
            yield Explored(replace(row, why=str(error)), None)
        else:
            yield Explored(replace(row, file=f"explore-{i + 1}-{file_name(name)}.html"), page)


def _alone(text: CaseText, found: SweepResult, i: int, member: int) -> CaseText:
    """Return the case file with a member's numbers and one controller."""
    if text.case().problem.noise is not None:
        raise InputError("pages do not contain the member's measurement noise")
    varied = VariedCase(text, found.plan.paths, redesign=found.redesign)
    tables = varied.tables_at(found.plan.values(member, 1)[0])
    written = tables.get("controller", [])
    tables["controller"] = written[i : i + 1]
    tables["name"] = f"{found.case}, member {member}"
    own = None if text.own is None else text.own.alone(i - len(written))
    return replace(text, text=toml({key: value for key, value in tables.items() if value != []}), own=own)
