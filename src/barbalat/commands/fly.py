"""``barbalat fly`` flies sampled controllers on a flight model through failures."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from barbalat.commands.options import add_budget, add_controllers, add_list, whole
from barbalat.commands.output import folder_of, require_folder_name, tell
from barbalat.commands.progress import Work, say, work

if TYPE_CHECKING:
    from barbalat.commands import Commands
    from barbalat.vehicles.comparison import FlightComparison

DEFAULT_FOLDER = "barbalat-fly"


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser(
        "fly", help="fly sampled controllers on flight models and inject failures; requires barbalat[flight]"
    )
    parser.add_argument(
        "name", metavar="NAME", help="f16-pitch, f16-roll: the F-16 tracks a rate command; quadrotor: flies a figure of eight"
    )
    add_list(
        parser,
        "--schemes",
        metavar="NAME",
        commas=True,
        help="names of the project's schemes, separated by spaces or commas; default: all",
    )
    add_list(
        parser,
        "--failure",
        "--failures",
        metavar="NAME",
        commas=True,
        help="names of the flight's failures, separated by spaces or commas; default: all",
    )
    parser.add_argument(
        "--delays", action="store_true", help="also increase the delay until control is lost; this doubles the run time"
    )
    parser.add_argument(
        "--dispersions",
        type=whole,
        metavar="N",
        help="fly N random vehicles in all failure cases instead, and report losses and errors with confidence intervals",
    )
    parser.add_argument("--seed", type=whole, metavar="N", help="seed of the draws; default 2013")
    parser.add_argument(
        "--store",
        metavar="DIR",
        help="folder in which the result of each draw is stored; running the same command again resumes the campaign",
    )
    parser.add_argument("--altitude", type=float, metavar="FT", help="altitude of the F-16's level flight [ft]; default 10013")
    parser.add_argument("--mach", type=float, metavar="M", help="Mach number of the F-16's level flight; default 0.525")
    parser.add_argument(
        "--sil",
        action="store_true",
        help="software in the loop: fly the controllers as exported C, compiled on this machine with cc or CC; exit code 1 if "
        "any bit differs",
    )
    parser.add_argument("--out", metavar="DIR", help=f"default: {DEFAULT_FOLDER}, or none with --json")
    parser.add_argument("--json", action="store_true", help="print one JSON document on standard output")
    add_controllers(parser)
    add_budget(parser)
    parser.set_defaults(execute=execute)


MOST_DRAWS = 1_000_000
"""Largest number of draws; so many would take more than a year on two cores."""
NOT_DRAWN = {
    "delays": "each draw of a campaign has a different delay",
    "sil": "a campaign flies the simulated controllers; compare the exported C with them in single flights",
    "altitude": "the draws of a campaign have their own flight conditions",
    "mach": "the draws of a campaign have their own flight conditions",
    "controllers": "a campaign flies only the project's schemes",
}
"""Options that a campaign does not accept, with the reasons."""
EXPECTED_SECONDS = {"flying": 40.0, "drawing": 10.0}
"""Estimated seconds until the first report of progress."""


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    from barbalat.vehicles.isolated import SimulatorFailed

    if options.dispersions is not None:
        return _execute_dispersed(options)
    _require_none(options, ("seed", "store"), "needs a campaign: add --dispersions 200")
    if options.sil:
        from barbalat.export.compiler import require_compiler

        require_compiler("--sil flies the exported C")  # before anything is flown
    try:
        with folder_of(options.out, None if options.json else DEFAULT_FOLDER) as folder, work(EXPECTED_SECONDS) as running:
            found = _flown(options, running)
            from barbalat.report import documents, flights, write

            document = documents.as_json(flights.as_document(found))
            if folder is not None:
                with running.part("drawing"):
                    folder.write("fly.json", document)
                    write.write_flights(folder, found)
                    folder.commit(gone=write.files_of_flights())
    except SimulatorFailed as error:
        say(f"barbalat: {error}")
        return 1
    from barbalat.report.file_names import PAGE

    tell(document, lambda screen: flights.show(screen, found), folder, as_json=options.json, page=PAGE)
    return int(any(one.equal is False for one in (found.agreements or {}).values()))


def _require_none(options: argparse.Namespace, names: Sequence[str], remedy: str) -> None:
    from barbalat.validate import InputError

    for name in names:
        if vars(options)[name] not in (None, False):
            raise InputError(f"--{name} {remedy}")


def _execute_dispersed(options: argparse.Namespace) -> int:
    from barbalat import validate
    from barbalat.report import dispersed, documents, page
    from barbalat.report.file_names import PAGE
    from barbalat.vehicles.dispersed import fly_dispersed
    from barbalat.vehicles.isolated import SimulatorFailed
    from barbalat.vehicles.vehicle import SEED

    require_folder_name("--store", options.store)
    validate.whole("--dispersions", options.dispersions, least=1, most=MOST_DRAWS)
    for name, instead in NOT_DRAWN.items():
        _require_none(options, (name,), f"cannot be combined with --dispersions: {instead}")
    try:
        with folder_of(options.out, None if options.json else DEFAULT_FOLDER) as folder, work({"flying": 1200.0}) as running:
            with running.part("flying", here=False) as progress:
                found = fly_dispersed(
                    options.name,
                    schemes=options.schemes or None,
                    failures=options.failure or None,
                    members=options.dispersions,
                    seed=SEED if options.seed is None else options.seed,
                    store=options.store,
                    progress=progress,
                )
            document = documents.as_json(dispersed.as_document(found))
            if folder is not None:
                folder.write("fly.json", document)
                folder.write(PAGE, page.dispersed_flights(found))
                folder.commit()
    except SimulatorFailed as error:
        kept = f". The results in {options.store} are kept; run the same command again to continue"
        stays = "" if options.store is None else kept
        say(f"barbalat: {error}{stays}")
        return 1

    tell(document, lambda screen: dispersed.show(screen, found), folder, as_json=options.json, page=PAGE)
    return 0


def _flown(options: argparse.Namespace, running: Work) -> FlightComparison:
    from barbalat.cases import user_controllers
    from barbalat.export.exported_step import exported_c
    from barbalat.vehicles.flying import fly
    from barbalat.vehicles.vehicle import vehicle_of

    own = () if options.controllers is None else user_controllers.run(options.controllers).controllers(named={})
    given = {name: value for name, value in (("altitude", options.altitude), ("mach", options.mach)) if value is not None}
    with running.part("flying", here=False) as progress:
        return fly(
            options.name,
            schemes=options.schemes or None,
            controllers=own,
            failures=options.failure or None,
            condition=vehicle_of(options.name).condition(given) if given else None,
            delays=options.delays,
            software_in_the_loop=exported_c if options.sil else None,
            progress=progress,
        )
