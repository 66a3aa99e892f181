"""``barbalat sweep`` runs a case many times, over a grid, random draws or both, and computes statistics."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING

from barbalat.commands.options import add_case, add_list, conclude, pair, varied, whole
from barbalat.commands.output import folder_of, print_json, require_folder_name, tell
from barbalat.commands.progress import SECONDS_EACH_STEP, Work, say, work

if TYPE_CHECKING:
    from pathlib import Path

    from barbalat.budget import Progress
    from barbalat.cases.load import CaseText
    from barbalat.commands import Commands
    from barbalat.folders import Folder
    from barbalat.open_numbers.path import FieldPath
    from barbalat.problem.labels import Labels
    from barbalat.sweeps.cluster import Scheduler
    from barbalat.sweeps.requirement import Requirement
    from barbalat.sweeps.result import SweepResult
    from barbalat.sweeps.spread import Axis, Distribution
    from barbalat.sweeps.study import Study


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("sweep", help="run a case many times: a grid, a Monte Carlo study, or both")
    add_case(parser)
    add_list(
        parser, "--vary", metavar="PATH=START:STOP:COUNT[:log]", form="=",
        help="values of a parameter of the case file, such as controller[0].gamma=1:1e6:13:log; several make a grid",
    )  # fmt: skip
    add_list(
        parser, "--sample", metavar="PATH=DISTRIBUTION", form="=",
        help="uniform:A:B, normal:MEAN:DEVIATION, loguniform:A:B, known-set (a vector or a gain from the case's known set) or "
        "between (one parameter, parameters.k, or all of them, parameters, from their ranges)",
    )  # fmt: skip
    parser.add_argument("--members", type=whole, metavar="N", help="draws at each point of the grid; default 1000 with --sample")
    parser.add_argument(
        "--design", choices=("latin", "sobol", "random", "saltelli"),
        help="kind of draws: Latin hypercubes (default), a Sobol sequence, independent draws (which give exact intervals) or "
        "Saltelli's scheme",
    )  # fmt: skip
    parser.add_argument("--seed", type=whole, default=0, metavar="S", help="seed of the draws; default 0")
    parser.add_argument(
        "--redesign", action="store_true",
        help="redesign the model and the controllers for the plant and parameters of each member; by default only the simulated "
        "plant varies",
    )  # fmt: skip
    add_list(
        parser,
        "--require",
        metavar="REQUIREMENT",
        form="[<>]",
        help='count violations of a requirement, such as "max_abs_e[0] < 2"',
    )
    add_list(
        parser, "--worst", metavar="METRIC",
        help="search for the smallest and largest value of a metric instead of sweeping: gradient search from --members starting "
        "points (default 64) over the given ranges, or over the known set if none are given. The counts of the ranges are "
        "ignored, and the result is not a proof",
    )  # fmt: skip
    parser.add_argument("--no-bounds", action="store_true", help="do not compare members with guaranteed bounds")
    parser.add_argument(
        "--audit", type=whole, metavar="N",
        help="number of members to repeat at half the step, which finds verdicts that depend on the solver; default 2 %% of the "
        "members, at least 30",
    )  # fmt: skip
    parser.add_argument(
        "--scheduler", metavar="ADDRESS",
        help="tcp://HOST:PORT of a Dask scheduler, or local:N for N processes here; default: threads",
    )  # fmt: skip
    parser.add_argument(
        "--store",
        metavar="DIR",
        help="folder in which the results of all members are stored as Parquet; running the same command again continues an "
        "interrupted sweep",
    )
    parser.add_argument(
        "--member", type=whole, metavar="K", help="repeat only this member, bit for bit, and write its record and a page"
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        help="folder for the page, or for the page of a single member; default: barbalat-sweep, or none with --json",
    )
    conclude(parser, execute)


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    from barbalat.cases.load import CaseText
    from barbalat.open_numbers.path import by_index
    from barbalat.sweeps.cluster import Scheduler, SchedulerLostError
    from barbalat.sweeps.requirement import Requirement

    if options.worst:
        return _searched(options)
    store = None if options.store is None else _folder(options.store)
    scheduler = None if options.scheduler is None else Scheduler.parse(options.scheduler)
    text = CaseText.read(options.case, options.controllers)
    study = _study(text, options)
    requirements = [Requirement.parse(by_index(one, study.example.problem.labels)) for one in options.require]
    if options.member is not None:
        return _replayed(study, store, options)
    with folder_of(options.out, None if options.json else "barbalat-sweep") as folder:
        try:
            result = _run(study, requirements, scheduler, store, options)
        except SchedulerLostError:
            stays = f"the results in {options.store} are kept; run the same command again to continue"
            what = "without --store nothing is kept" if options.store is None else stays
            say(f"the scheduler {options.scheduler} no longer answers; {what}")
            return EXIT_FAILED
        from barbalat.report import documents

        document = documents.as_json(result.as_json())
        if folder is not None:
            folder.write("sweep.json", document)
            _write(folder, text, study, result)
    from barbalat.report import sweep
    from barbalat.report.file_names import PAGE

    tell(
        document, lambda screen: sweep.show(screen, result, study.example.problem.labels), folder, as_json=options.json, page=PAGE
    )
    return 0


NOT_OF_A_SEARCH = ("design", "require", "audit", "scheduler", "store", "member", "out", "no_bounds")
"""Options of a sweep that a search for the worst member does not use."""


def _searched(options: argparse.Namespace) -> int:
    """Search for the worst members. Return the exit code."""
    from barbalat.cases.load import CaseText
    from barbalat.report import documents, worst
    from barbalat.sweeps.known_set_draws import sampled
    from barbalat.sweeps.worst import STARTS, search_worst
    from barbalat.validate import InputError

    for name in NOT_OF_A_SEARCH:
        value = getattr(options, name)
        if not (value is None or value is False or value == []):
            raise InputError(
                f"--{name.replace('_', '-')} belongs to a sweep, but --worst runs a search instead: leave one of them out"
            )
    text = CaseText.read(options.case, options.controllers)
    labels = text.case().problem.labels
    given: list[tuple[FieldPath, Axis | Distribution]] = [*_axes(options, labels).items()]
    given += sampled(text, [pair(one, TAKEN) for one in options.sample]).items()
    with work({"searching": 20.0}) as running, running.part("searching") as progress:
        found = search_worst(
            text,
            options.worst,
            given,
            starts=STARTS if options.members is None else options.members,
            seed=options.seed,
            redesign=options.redesign,
            progress=progress,
        )
    document = documents.as_json(found.as_json())
    tell(document, lambda screen: worst.show(screen, found, labels), None, as_json=options.json)
    return 0


def _replayed(study: Study, store: Path | None, options: argparse.Namespace) -> int:
    """Run a single member. Return the exit code, which is 1 if the member's metrics differ from the stored ones."""
    from barbalat.commands import run
    from barbalat.report import documents
    from barbalat.sweeps.stored import require_parquet, row_of
    from barbalat.sweeps.sweep import replay

    if store is not None:
        require_parquet()
    stored = None if store is None else row_of(store, study.identity(), options.member)
    default = None if options.json else f"barbalat-member-{options.member}"
    parts = {"simulating": 3.0, "certifying": 2.0, "drawing": 0.3}
    with folder_of(options.out, default) as folder, work(parts) as running:
        with running.part("simulating") as progress:
            found = replay(study, options.member, progress=progress)
        results = list(found.results)
        document = documents.run_document(found.case.name, results, None)
        if folder is not None:
            run.write_runs(folder, found.case.name, results, documents.as_json(document))
            run.with_page(folder, found.case, results, running)
    if options.json:
        varied = {str(path): float(found.columns[str(path)][0]) for path in study.plan.paths}
        print_json(documents.as_json({"member": found.number, "varied": varied, **document}))
    else:
        run.show(f"{found.case.name}, member {found.number}", results, folder, plots=True)
    if stored is None or not (different := found.differing(stored)):
        return 0
    say(
        f"member {found.number} differs from the store, which was written on a different processor or by different versions, in: "
        f"{', '.join(different)}"
    )
    return 1


def _write(folder: Folder, text: CaseText, study: Study, result: SweepResult) -> None:
    """Write the page with the worst members' runs, and their explorers in the same folder."""
    from barbalat.explorer.worst_members import explored
    from barbalat.report import write
    from barbalat.sweeps.sweep import worst_runs

    parts = {"explorers": SECONDS_EACH_EXPLORER * len(result.controllers), "drawing": DRAWING_SECONDS}
    with work(parts) as running:
        worst = []
        with running.part("explorers") as progress:
            for one in explored(text, result):
                worst.append(one.row)
                if one.page is not None and one.row.file is not None:
                    folder.write(one.row.file, one.page)
                progress(len(worst) / len(result.controllers))
        with running.part("drawing"):
            write.write_sweep(folder, result, worst, worst_runs(study, result) if result.judged else None)
    folder.commit()


def _study(text: CaseText, options: argparse.Namespace) -> Study:
    from barbalat.open_numbers.varied import VariedCase
    from barbalat.sweeps.known_set_draws import sampled
    from barbalat.sweeps.plan import Design, Plan, members_of
    from barbalat.sweeps.study import Study

    axes = _axes(options, text.case().problem.labels)  # errors in the file are reported first
    draws = sampled(text, [pair(given, TAKEN) for given in options.sample])
    design = Design(options.design or "latin")
    plan = Plan(axes, draws, members_of(options.members, design, drawn=bool(draws)), design, options.seed)
    return Study(VariedCase(text, plan.paths, redesign=options.redesign), plan)


def _axes(options: argparse.Namespace, labels: Labels | None) -> dict[FieldPath, Axis]:
    """The values of ``--vary``."""
    from barbalat.open_numbers.path import by_index
    from barbalat.sweeps.spread import Axis

    pairs = (pair(given, TAKEN) for given in options.vary)
    return varied(((by_index(place, labels), values) for place, values in pairs), Axis.parse)


TAKEN = "--vary and --sample take PATH=VALUES, such as plant.theta[0]=uniform:-5:5"
SECONDS_EACH_EXPLORER, DRAWING_SECONDS = 1.0, 2.0


EXIT_FAILED = 1
"""Exit code if a member fails although the input is valid."""


def _run(
    study: Study,
    requirements: list[Requirement],
    scheduler: Scheduler | None,
    store: Path | None,
    options: argparse.Namespace,
) -> SweepResult:
    from barbalat.sweeps.sweep import run_study
    from barbalat.validate import counted

    steps, simulation = len(study) * study.steps, study.example.simulation
    what = f"{steps:.3g} solver steps" if simulation.tolerance is None else simulation.how
    say(f"{counted(len(study), 'member')}, {what}")
    try:
        with work({"simulating": max(steps * SECONDS_EACH_STEP, 1.0)}) as running, running.part("simulating") as progress:
            return run_study(
                study,
                requirements=requirements,
                store=store,
                scheduler=scheduler,
                bounds=not options.no_bounds,
                audit=options.audit,
                progress=_with_rate(running, progress, len(study)),
                told=say,
            )
    except KeyboardInterrupt:
        if store is not None:
            say(
                f"the completed chunks are stored in {store}; run the same command again to continue"
                if store.exists()
                else f"nothing is stored in {store} yet, because no chunk of members was complete"
            )
        raise


def _folder(name: str) -> Path:
    from barbalat.validate import local_path

    require_folder_name("--store", name)
    return local_path("--store", name)


def _with_rate(running: Work, progress: Progress, members: int) -> Progress:
    """Return a progress function that also shows the number of members per second."""
    begun, start = time.perf_counter(), None

    def advanced(fraction: float) -> None:
        nonlocal start
        start = fraction if start is None else start  # type: ignore[redundant-expr]
        seconds = time.perf_counter() - begun
        running.name = f"simulating, {(fraction - start) * members / max(seconds, 1e-9):.3g} members/s"
        progress(fraction)

    return advanced
