"""``barbalat export``: a case's controller as source for a flight computer, or as a unit for co-simulation."""

from __future__ import annotations

import argparse
import shlex
from typing import TYPE_CHECKING

from barbalat.commands.options import add_controllers, conclude
from barbalat.commands.output import print_json, require_folder_name
from barbalat.commands.progress import say, work

if TYPE_CHECKING:
    from collections.abc import Iterator

    from barbalat.cases.build import Case
    from barbalat.commands import Commands
    from barbalat.export.campaign import Campaign, Degradation
    from barbalat.protocols import Controller
    from barbalat.report.terminal.layout import Screen


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("export", help="write a sampled controller as C that reproduces the simulation bit for bit")
    parser.add_argument("case", metavar="CASE", help="a case file, or a bundled case's name")
    parser.add_argument("--controller", required=True, metavar="NAME", help="name of a sampled controller of the case")
    parser.add_argument("--target", metavar="TARGET", choices=Targets(), default="c99", help="one of %(choices)s; c99 by default")
    parser.add_argument(
        "--out", required=True, metavar="DIR", help="folder for the export; an existing export there is replaced completely"
    )
    parser.add_argument("--name", metavar="PREFIX", help="prefix of functions, types, macros and files")
    parser.add_argument(
        "--parameters", action="store_true", help="make gains, limits and initial estimates settable while the exported C runs"
    )
    parser.add_argument("--float32", action="store_true", help="use 32-bit instead of 64-bit numbers")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--controller-only", action="store_true", help="export only the controller (the default)")
    which.add_argument("--closed-loop", action="store_true", help="also export the plant and the whole loop")
    parser.add_argument(
        "--campaign", action="store_true", help="first run the compiled C through faults; this needs a C compiler on this machine"
    )
    parser.add_argument("--sources-only", action="store_true", help="write FMUs without a binary, which needs no C compiler")
    add_controllers(parser)
    conclude(parser, execute)


class Targets:
    """The names of all targets, searched only when a user requests a target or asks for help, so that other commands start
    fast."""

    def __iter__(self) -> Iterator[str]:
        from barbalat.export.target import targets

        return iter(targets())

    def __contains__(self, name: str) -> bool:
        return name in iter(self)


def _flown(case: Case, controller: Controller, *, float32: bool) -> Campaign:
    """Run the exported C of the controller through the faults of the case and through others, with a progress bar."""
    from barbalat.export.campaign import EXPECTED_SECONDS, export_campaign

    with work({"campaign": EXPECTED_SECONDS}) as running, running.part("campaign") as progress:
        return export_campaign(case.problem, controller, case.simulation, float32=float32, judge=case.judge, progress=progress)


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    from barbalat.cases.load import load_case
    from barbalat.export.c99.files import FILES
    from barbalat.export.layout import require_prefix
    from barbalat.export.target import targets
    from barbalat.export.write import export_controller
    from barbalat.validate import InputError, local_path, show

    require_folder_name("--out", options.out)
    out = local_path("--out", options.out)
    case = load_case(options.case, options.controllers)
    found = {controller.name: controller for controller in case.controllers}
    if options.controller not in found:
        raise InputError(f"--controller must be one of {', '.join(map(show, found))}, got {show(options.controller)}")
    controller = found[options.controller]
    target = targets()[options.target]
    if options.name is not None:
        require_prefix(options.name)
    notes: list[str] = []
    flown = _flown(case, controller, float32=options.float32 or target.float32) if options.campaign else None
    folder = export_controller(
        case.problem,
        controller,
        case.simulation,
        out=out,
        target=options.target,
        float32=options.float32,
        closed_loop=options.closed_loop,
        sources_only=options.sources_only,
        place=list(found).index(controller.name),
        name=options.name,
        parameters=options.parameters,
        judge=case.judge,
        note=notes.append,
    )
    check = target.check(shlex.quote(str(folder)), options.closed_loop)
    if options.name is not None:
        check = FILES.sub(rf"{options.name}_\1", check)
    if options.json:
        from barbalat.report.documents import as_json

        files = sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file())
        about = {"case": case.name, "controller": controller.name, "target": options.target, "folder": str(folder)}
        flights = {} if flown is None else {"campaign": flown.as_json()}
        print_json(as_json({**about, "files": files, "check": check, **flights, **({"notes": notes} if notes else {})}))
    else:
        if flown is not None:
            from barbalat.report.terminal.layout import Screen

            _show(Screen(), flown)
        for one in notes:
            say(one)
        say(f"written: {folder}; check it with: {check}")
        if options.closed_loop and case.problem.faults:
            say("the exported plant and loop do not contain the case's [[faults]]; they simulate the case without faults")
    return 0


def _show(screen: Screen, found: Campaign) -> None:
    """Print the effect of faults, compared with the run without faults, and the longest tolerated outage."""
    from barbalat.export.campaign import TOLERATED
    from barbalat.validate import counted

    screen.title(f"{found.controller}: the compiled C run through faults")
    screen.line(f"Without faults: {found.sentence}.")
    judged = _table(screen, found)
    outage = f"{counted(found.longest, 'sample')}, {found.longest * found.sample_time:.4g} s"
    one_more = (
        "it is the longest one tried" if found.worst is None else f"one sample longer from t = {found.worst:.6g} s on did harm"
    )
    screen.line(
        f"The longest outage that did no harm from any of {counted(len(found.starts), 'instant')} tried: {outage}; {one_more}. "
        f"This is an estimate: a shorter outage from another instant may do harm. An outage does harm if the largest |e_i| of "
        f"some component i exceeds {TOLERATED:g} times its fault-free value."
    )
    if found.allowed is not None and found.allowed > found.longest:
        screen.line(
            f"The shell's longest_outage is longer, {counted(found.allowed, 'sample')}: its fallback acts only after that."
        )
    fewest, most = min(row.draws for row in found.rows), max(row.draws for row in found.rows)
    draws = counted(most, "draw") if fewest == most else f"{fewest} to {most} draws"
    screen.line(
        f"Each row is the worst of {draws}; only the number of missed samples is their mean, counted until a run diverges. Time "
        f"beyond: the fraction of time for which any |e_i| exceeds its fault-free maximum. Factor: the largest |e_i| divided by "
        f"its fault-free maximum, for the worst component. "
        + (
            "The judge gives a verdict on each draw. A verdict is shown if it differs from the verdict without faults; a verdict "
            "without a count applies to all draws."
            if judged
            else "The judge's verdict on every draw is the same as without faults."
        )
    )


def _table(screen: Screen, found: Campaign) -> bool:
    """Print a row for each kind of faults. Return whether a verdict differs from that without faults; only then there is a column
    of verdicts."""
    from barbalat.judge.verdict import percent

    all_errors = len(found.names) <= MOST_ERROR_COLUMNS
    errors = [f"max |e|\n{one}" for one in _components(found)] if all_errors else ["worst\nmax |e|"]
    unchanged = [f"{value:.4g}" for value in found.nominal] if all_errors else ["-"]
    verdicts = ["" if row.verdict == found.verdict else row.verdict for row in found.rows]
    judged = any(verdicts)
    rows = [["none", *[found.verdict] * judged, percent(found.missed), "0 %", *unchanged, "1"]]
    for row, verdict in zip(found.rows, verdicts, strict=True):
        rows.append([row.faults, *[verdict] * judged, *_figures(found, row, all_errors=all_errors)])
    screen.table(["faults", *["verdict"] * judged, "missed\nsamples", "time\nbeyond", *errors, "factor"], rows)
    return judged


def _components(found: Campaign) -> list[str]:
    units = found.units or ("",) * len(found.names)
    return [f"{name} [{unit}]" if unit else name for name, unit in zip(found.names, units, strict=True)]


MOST_ERROR_COLUMNS = 3
"""Number of components up to which each has a column; if there are more, a row shows the component that grows most."""


def _figures(found: Campaign, row: Degradation, *, all_errors: bool) -> list[str]:
    """The entries of a row after its verdict."""
    from barbalat.judge.verdict import percent

    i = found.worst_component(row)
    factor = "-" if i is None else f"{found.factor(row):.3g}"
    shares = [percent(row.missed), percent(row.beyond)]
    errors = ["-"] * (len(found.nominal) if all_errors else 1)
    if row.worst is not None and i is not None:
        errors = [f"{value:.4g}" for value in row.worst] if all_errors else [f"{row.worst[i]:.4g} in {_components(found)[i]}"]
    return [*shares, *errors, factor]
