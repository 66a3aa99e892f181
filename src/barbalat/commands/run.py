"""``barbalat run``: simulate and compare a case's controllers."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from barbalat.commands.options import add_budget, add_case
from barbalat.commands.output import folder_of, print_json
from barbalat.commands.progress import Work, say, work

if TYPE_CHECKING:
    from barbalat.cases.build import Case
    from barbalat.commands import Commands
    from barbalat.folders import Folder
    from barbalat.run.results.result import Result


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("run", help="simulate and compare a case's controllers")
    add_case(parser)
    parser.add_argument(
        "--out",
        metavar="DIR",
        help="folder for the page, the JSON and the trajectories; default: barbalat-run, or none with --json",
    )
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    parser.add_argument(
        "--full", action="store_true", help="show every component, the estimates, the excitation and the numerical checks"
    )
    parser.add_argument(
        "--full-record", action="store_true", help="write every recorded point to the CSV files; default: about 1000 points"
    )
    plots = parser.add_mutually_exclusive_group()
    plots.add_argument("--pictures", action="store_true", help="also write the charts of the page as PNG and SVG")
    plots.add_argument("--no-plots", action="store_true", help="write no page and no pictures")
    parser.add_argument(
        "--accuracy", action="store_true", help="measure the error of the fixed-step run against a variable-step run"
    )
    parser.add_argument(
        "--sil",
        action="store_true",
        help="software in the loop: run sampled controllers again as exported C, compiled on this machine; exit code 1 if any "
        "bit differs or a controller cannot be compared",
    )
    add_budget(parser)
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    from barbalat.cases.load import load_case

    case = load_case(options.case, options.controllers)
    require_commands_taken(case)
    with folder_of(options.out, None if options.json or options.no_plots else "barbalat-run") as folder:
        plots = folder is not None and not options.no_plots
        if options.sil:
            require_sampled(case)
        with work(_expected(case, plots=plots, pictures=options.pictures)) as running:
            results = _simulated(case, running, measured=options.accuracy)
            from barbalat.report import documents

            checked = compared_exports(results, running) if options.sil else None
            document = documents.as_json(documents.run_document(case.name, results, None, checked))
            if folder is not None:
                write_runs(folder, case.name, results, document, whole=options.full_record)
                if plots:
                    document = with_page(folder, case, results, running, checked, pictures=options.pictures)
        if options.json:
            print_json(document)
        else:
            show(case.name, results, folder, plots=plots, more="" if options.full else f"barbalat run {options.case} --full")
            show_exported(checked or {})
    return exit_code(checked or {})


CERTIFYING_SECONDS, PAGE_SECONDS, DRAWING_SECONDS = 0.2, 0.1, 0.4
"""Estimated seconds for certificates, page and pictures, for each controller; all pictures together take one more second."""
STEPS_EACH_SECOND = 5e6
"""Estimated speed for a small loop. Compiling a controller's code takes ``COMPILING_SECONDS`` seconds in addition."""
COMPILING_SECONDS = 0.2


def _expected(case: Case, *, plots: bool, pictures: bool) -> dict[str, float]:
    """Return the expected seconds of each part of the work."""
    count = len(case.controllers)
    seconds = count * (COMPILING_SECONDS + case.simulation.steps / STEPS_EACH_SECOND)
    simulating = {"simulating": seconds, "halving the step": seconds}
    drawing = PAGE_SECONDS * count + (1 + DRAWING_SECONDS * count if pictures else 0)
    return simulating | ({"certifying": CERTIFYING_SECONDS * count, "drawing": drawing} if plots else {})


def _simulated(case: Case, running: Work, *, measured: bool) -> list[Result]:
    """Run all controllers, examine short tails closely, and repeat the runs at half the step. Runs that left the stability region
    of their solver, or whose oscillations the step damps, are also repeated at a finer step. Count missed samples."""
    from barbalat.run.engine.check_numerics import check_numerics
    from barbalat.run.engine.judging import tail_is_short
    from barbalat.run.engine.settle import halved, settle
    from barbalat.run.engine.simulate import simulate, with_missed_samples

    with running.part("simulating") as progress:
        judge = replace(case.judge, closely=case.judge.closely or tail_is_short(case.problem, case.simulation))
        found = simulate(case.problem, case.controllers, case.simulation, judge=judge, progress=progress)
    outside = [name for name, result in found.items() if result.stiffness.unstable_from is not None]
    if outside:
        say(f"outside the region of stability, repeated at a finer step: {', '.join(outside)}")
    if outside or measured:
        with running.part("checking the numerics") as progress:
            found = check_numerics(found, measured=measured, progress=progress)
    with running.part("halving the step") as progress:
        return list(with_missed_samples(halved(settle(found), progress=progress)).values())


def write_runs(folder: Folder, case: str, results: Sequence[Result], document: str, *, whole: bool = False) -> None:
    """Write the JSON, the trajectories and the description of their columns before the certificates, so that the runs are
    safe."""
    from barbalat.report.documents import as_json
    from barbalat.report.file_names import COLUMNS, RUN, files_of_run
    from barbalat.report.trajectories import data_package, write_trajectories

    folder.write(RUN, document)
    folder.write(COLUMNS, as_json(data_package(case, results)))
    write_trajectories(folder, results, whole=whole)
    folder.commit(gone=files_of_run(folder.path))


@contextlib.contextmanager
def _kept(folder: Folder) -> Iterator[None]:
    """On Ctrl-C, print which results already exist."""
    try:
        yield
    except KeyboardInterrupt:
        say(f"the metrics and trajectories are kept in {folder.path}, without a page")
        raise


def with_page(
    folder: Folder,
    case: Case,
    results: Sequence[Result],
    running: Work,
    compiled: Mapping[str, Mapping[str, Any]] | None = None,
    *,
    pictures: bool = False,
) -> str:
    """Certify, write the page, and, with ``pictures``, its charts. Return the JSON document."""
    from barbalat.certificates.certify import certified_case
    from barbalat.report import documents
    from barbalat.report.file_names import RUN
    from barbalat.report.run_pages import write_comparison

    with _kept(folder):
        with running.part("certifying") as progress:
            certified = certified_case(case.problem, case.controllers, case.simulation, progress)
        with running.part("drawing"):
            document = documents.as_json(documents.run_document(case.name, results, certified, compiled))
            folder.write(RUN, document)
            write_comparison(folder, case.name, results, certified, pictures=pictures)
            folder.commit()
    return document


def show(case: str, results: Sequence[Result], folder: Folder | None, *, plots: bool, more: str = "") -> None:
    """Print a sentence for each controller, a table, the findings, and the location of the files.

    more the command that shows everything; if it is empty, everything is shown
    """
    from barbalat.report.file_names import PAGE
    from barbalat.report.terminal import runs
    from barbalat.report.terminal.layout import Screen

    screen = Screen()
    (runs.show if more else runs.show_full)(screen, case, results)
    screen.line("")
    if folder is not None:
        screen.whole(f"page: {folder.path / PAGE}" if plots else f"written to {folder.path}")
    if more:
        screen.whole(f"everything: {more}")


def require_sampled(case: Case) -> None:
    """Raise InputError before any simulation if no C can be run or no controller can be exported."""
    from barbalat.export.compiler import require_compiler
    from barbalat.loop.closed_loop import ClosedLoop
    from barbalat.validate import InputError

    require_compiler()
    if not any(ClosedLoop.of(case.problem, controller).sampled for controller in case.controllers):
        raise InputError("--sil needs a sampled controller, and this case has none: give one a sample_time")


def require_commands_taken(case: Case) -> None:
    """Raise InputError before any simulation if the shell rejects the command of the case, as an export does."""
    if case.problem.shell is None:
        return
    import numpy as np

    from barbalat.export.contents import VECTORS
    from barbalat.loop.around import Around
    from barbalat.loop.closed_loop import ClosedLoop

    for controller in case.controllers:
        around = Around.of_shell(case.problem, ClosedLoop.of(case.problem, controller).sample_time)
        if around is not None and around.checks_commands:
            t = np.arange(VECTORS) * around.T
            t = t[t < case.simulation.t_end]
            commands = np.column_stack([one(t) for one in case.problem.commands])
            around.require_taken(np.zeros((0, len(around.low))), commands, case.problem)


def compared_exports(results: Sequence[Result], running: Work) -> dict[str, dict[str, Any]]:
    """Return, for each sampled controller, whether every bit is equal and, if not, the difference or the reason why there is no
    result."""
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


def show_exported(found: Mapping[str, Mapping[str, Any]]) -> None:
    """Print the results, one line for each controller."""
    from barbalat.report.terminal.layout import Screen
    from barbalat.validate import counted

    screen = Screen()
    if found:
        screen.title("software in the loop", "")
    for name, one in found.items():
        lost = f"; a measurement, a command or a result was lost or rejected at {counted(one['refused'], 'sample')}"
        equal = "compiled as C, it gives the same metrics and states, bit for bit"
        told = f"not compared: {one['difference']}" if one["equal"] is None else one["difference"] or equal
        screen.whole(f"{name}: {told}{lost if one['refused'] else ''}")


def exit_code(found: Mapping[str, Mapping[str, Any]]) -> int:
    """Return 1 if a bit differs or a controller could not be compared, else 0."""
    return int(not all(one["equal"] for one in found.values()))
