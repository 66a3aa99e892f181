"""``barbalat run --sil``: each sampled controller once more, as the C that would be exported."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from barbalat.commands.progress import Work

if TYPE_CHECKING:
    from barbalat.cases.build import Case
    from barbalat.run.results.result import Result


def require(case: Case) -> None:
    """InputError before anything is simulated, where no C can run, or nothing could be exported."""
    from barbalat.export.compiler import require_compiler
    from barbalat.loop.closed_loop import ClosedLoop
    from barbalat.validate import InputError

    require_compiler()
    if not any(ClosedLoop.of(case.problem, controller).sampled for controller in case.controllers):
        raise InputError("--sil takes sampled controllers, and this case has none: give one a sample_time")


def checked(results: Sequence[Result], running: Work) -> dict[str, dict[str, Any]]:
    """What was found of each sampled controller: whether every bit is equal, and if not, what is not or why it can't be said."""
    from barbalat.export.in_the_loop import simulate_export
    from barbalat.validate import InputError

    found: dict[str, dict[str, Any]] = {}
    for result in (result for result in results if result.loop.sampled):
        try:
            with running.part(f"compiled C of {result.name}") as progress:
                made = simulate_export(result.problem, result.controller, result.simulation, progress=progress)
        except InputError as error:
            found[result.name] = {"equal": None, "refused": 0, "difference": str(error)}
            continue
        difference = made.differs_from(result)
        found[result.name] = {"equal": not difference, "refused": made.refused, "difference": difference}
    return found


def show(found: Mapping[str, Mapping[str, Any]]) -> None:
    """Print what was found, a line for each controller."""
    from barbalat.report.terminal.layout import Screen
    from barbalat.validate import counted

    screen = Screen()
    if found:
        screen.title("software in the loop", "")
    for name, one in found.items():
        samples = f"; the export refused {counted(one['refused'], 'sample')}" if one["refused"] else ""
        equal = "as compiled C it has the same figures and the same states in every bit"
        screen.whole(f"{name}: {equal if one['equal'] else one['difference']}{samples}")


def exit_code(found: Mapping[str, Mapping[str, Any]]) -> int:
    """1 where a bit differs; what can't be exported is no fault."""
    return int(any(one["equal"] is False for one in found.values()))
