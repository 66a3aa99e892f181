"""``barbalat fly``: sampled controllers on a flight model, through failures."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from barbalat.commands.options import add_controllers
from barbalat.commands.output import folder_of, print_json
from barbalat.commands.screen import Work, say, work

if TYPE_CHECKING:
    from barbalat.commands import Commands
    from barbalat.flight.comparison import FlightComparison

DEFAULT = "barbalat-fly"


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("fly", help="sampled controllers on JSBSim's F-16, with failures; needs the extra flight")
    parser.add_argument("name", metavar="NAME", help="f16-pitch, f16-roll: the F-16 follows a pitch-rate or a roll-rate command")
    parser.add_argument("--schemes", metavar="A,B", help="of the project's schemes, with commas between; default: all")
    parser.add_argument("--failure", action="append", metavar="NAME", help="a failure, again for more; default: all")
    parser.add_argument("--delays", action="store_true", help="raise the delay, too, until control is lost; takes twice as long")
    parser.add_argument("--altitude", type=float, default=10013.0, metavar="FT", help="of level flight; default 10013 ft")
    parser.add_argument("--mach", type=float, default=0.525, metavar="M", help="of level flight; default 0.525")
    parser.add_argument("--out", metavar="DIR", help=f"default: {DEFAULT}, none with --json")
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    add_controllers(parser)
    parser.set_defaults(execute=execute)


EXPECTED_SECONDS = {"flying": 40.0, "drawing": 10.0}
"""Until the first tells how far it is."""


def execute(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from barbalat.flight.isolated import SimulatorFailed

    try:
        with folder_of(options.out, None if options.json else DEFAULT) as folder, work(EXPECTED_SECONDS) as running:
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
    if options.json:
        print_json(document)
        return 0
    from barbalat.report.file_names import PAGE
    from barbalat.report.terminal import flights as terminal
    from barbalat.report.terminal.layout import Screen

    screen = Screen()
    terminal.show(screen, found)
    if folder is not None:
        screen.whole(f"page: {folder.path / PAGE}")
    return 0


def _flown(options: argparse.Namespace, running: Work) -> FlightComparison:
    from barbalat.cases import outside
    from barbalat.flight.airframe import FlightCondition
    from barbalat.flight.comparison import fly

    own = () if options.controllers is None else outside.run(options.controllers).controllers(named={})
    condition = FlightCondition(altitude=options.altitude, mach=options.mach)
    schemes = None if options.schemes is None else [name.strip() for name in options.schemes.split(",")]
    with running.part("flying", here=False) as progress:
        return fly(
            options.name,
            schemes=schemes,
            controllers=own,
            failures=options.failure,
            condition=condition,
            delays=options.delays,
            progress=progress,
        )
