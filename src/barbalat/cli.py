"""The command line: ``barbalat reproduce | run | cases | new``. A thin layer; heavy imports wait for their command."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import barbalat

if TYPE_CHECKING:
    from barbalat.engine import Progress

DONE, FAILED, BAD_INPUT = 0, 1, 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code: 0 done, 2 bad input, 1 anything else that went wrong."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.command(options))
    except BrokenPipeError:  # the reader, say ``head``, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except KeyboardInterrupt:
        _say("interrupted")
        return 130
    except ValueError as error:
        from barbalat.validate import InputError

        if not isinstance(error, InputError):
            raise
        _say(f"barbalat: {error}")
        return BAD_INPUT


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="barbalat",
        description="Design, certify, simulate adaptive controllers, and find out which claims about them are true.",
    )
    parser.add_argument("--version", action="version", version=f"barbalat {barbalat.__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    reproduce = commands.add_parser("reproduce", help="everything of the paper: figures, tables, claims")
    reproduce.add_argument("--out", type=Path, default=Path("barbalat-report"), metavar="DIR", help="default: %(default)s")
    reproduce.add_argument("--json", action="store_true", help="one JSON document on standard output")
    reproduce.set_defaults(command=_reproduce)

    run = commands.add_parser("run", help="simulate and compare a case's controllers")
    run.add_argument("case", metavar="CASE", help="a case file, or a bundled case's name")
    run.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="where pictures, page, JSON and trajectories go; default: barbalat-run, none with --json",
    )
    run.add_argument("--json", action="store_true", help="one JSON document on standard output")
    run.add_argument("--no-plots", action="store_true", help="no pictures and no page")
    run.set_defaults(command=_run)

    cases = commands.add_parser("cases", help="list the bundled cases")
    cases.set_defaults(command=_cases)

    new = commands.add_parser("new", help="write a commented case file to start from")
    new.add_argument("file", type=Path, metavar="FILE")
    new.set_defaults(command=_new)
    return parser


def _reproduce(options: argparse.Namespace) -> int:
    started = time.perf_counter()
    from barbalat.claims import figures as paper
    from barbalat.claims import section_v
    from barbalat.report import page, tables, write
    from barbalat.report.files import prepare_folder
    from barbalat.report.files import write as write_file

    folder = prepare_folder(options.out)
    seconds = {"start": time.perf_counter() - started}
    with _progress("simulating") as progress:
        runs = section_v.run(progress)
    seconds["simulations"] = time.perf_counter() - started - sum(seconds.values())
    figures, claims = paper.paper_figures(runs), [paper.erratum_claim(runs)]
    pictures = write.draw_reproduction(folder, figures)
    seconds["pictures"] = time.perf_counter() - started - sum(seconds.values())
    seconds["total"] = time.perf_counter() - started
    document = write.as_json(write.reproduction_document(figures, claims, seconds))
    write_file(folder / "report.html", page.reproduction(figures, claims, pictures, seconds))
    write_file(folder / "report.json", document)
    if options.json:
        print(document)  # noqa: T201
    else:
        console = tables.console()
        console.print(tables.checks_of_figures(figures), tables.ledger(claims))
        console.print(f"{sum(f.reproduced for f in figures)} of {len(figures)} figures reproduced in {seconds['total']:.1f} s")
        console.print(f"report: {folder / 'report.html'}")
    return DONE if all(figure.reproduced for figure in figures) else FAILED


def _run(options: argparse.Namespace) -> int:
    from barbalat.cases.load import load_case
    from barbalat.simulation import simulate

    case = load_case(options.case)
    folder = options.out
    if folder is None and not options.json and not options.no_plots:
        folder = Path("barbalat-run")
    if folder is not None:
        from barbalat.report.files import prepare_folder

        prepare_folder(folder)
    with _progress("simulating") as progress:
        results = list(simulate(case.problem, case.controllers, case.simulation, progress=progress).values())

    from barbalat.report import tables, write
    from barbalat.report.files import write as write_file

    document = write.as_json(write.run_document(case.name, results))
    if folder is not None:
        write_file(folder / "run.json", document)
        write.write_trajectories(folder, results)
        if not options.no_plots:
            write.write_comparison(folder, case.name, results)
    if options.json:
        print(document)  # noqa: T201
        return DONE
    console = tables.console()
    console.print(tables.figures_of_runs(results))
    for result in results:
        console.print(f"{result.name}: {result.numerics}")
    if folder is not None:
        console.print(f"written to {folder}")
    return DONE


def _cases(_: argparse.Namespace) -> int:
    from barbalat.cases.load import bundled, load_case
    from barbalat.report import tables

    console = tables.console()
    for name in bundled():
        case = load_case(name)
        schemes = ", ".join(controller.name for controller in case.controllers)
        console.print(f"{name:12} {case.name}: n = {case.problem.plant.n}; {schemes}")
    return DONE


def _new(options: argparse.Namespace) -> int:
    from importlib import resources

    from barbalat.report.files import prepare_folder, write
    from barbalat.validate import InputError

    if options.file.exists():
        raise InputError(f"{str(options.file)!r} exists already; choose another name")
    prepare_folder(options.file.parent)
    write(options.file, (resources.files("barbalat.cases") / "template.toml").read_bytes())
    _say(f"written: {options.file}; run it with: barbalat run {options.file}")
    return DONE


@contextlib.contextmanager
def _progress(what: str) -> Iterator[Progress]:
    """A progress bar on standard error; nothing where that is not a terminal."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    from barbalat.report.tables import console

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"), TimeRemainingColumn())
    screen = console(to_standard_error=True)
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda fraction: bar.update(task, completed=fraction)


def _say(text: str) -> None:
    print(text, file=sys.stderr)  # noqa: T201
