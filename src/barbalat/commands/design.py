"""``barbalat design`` compares all schemes and the fixed loop under a specification, and writes a page, a case file and C."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from barbalat.commands.options import add_schemes, conclude, trial_seconds, whole
from barbalat.commands.output import folder_of, tell, write_drawn
from barbalat.commands.progress import work

if TYPE_CHECKING:
    from barbalat.cases.load import CaseText
    from barbalat.commands import Commands
    from barbalat.comparison.design.design import Design
    from barbalat.folders import Folder


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("design", help="among all schemes, choose a controller that meets a specification")
    parser.add_argument("case", metavar="CASE", help="a case file with [specification] and a known set of the plant")
    add_schemes(parser)
    parser.add_argument(
        "--sample-time", type=float, metavar="S",
        help="sample time of all controllers [s]; default: that of the first sampled controller, or derived from the plant",
    )  # fmt: skip
    parser.add_argument(
        "--plants",
        type=whole,
        default=4,
        metavar="N",
        help="number of plants for tuning: the case's plant, extremes of its ranges, and random plants; default 4",
    )
    parser.add_argument(
        "--trials", type=whole, default=288, metavar="N", help="maximum number of tunings of each scheme; default and minimum 288"
    )
    parser.add_argument(
        "--members", type=whole, default=64, metavar="N", help="number of validation runs of each scheme; default 64"
    )
    parser.add_argument(
        "--seed", type=whole, default=0, metavar="S", help="seed of plants, searches, commands and noise; default 0"
    )
    parser.add_argument("--out", metavar="DIR", help="default: barbalat-design, or none with --json")
    conclude(parser, execute)


DRAWING_SECONDS = 40.0
CASE_FILE, PREFIX = "design.toml", "design"


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    from barbalat.cases.load import CaseText
    from barbalat.comparison.design.design import design
    from barbalat.report import design as screens
    from barbalat.report import documents
    from barbalat.report.file_names import PAGE

    text = CaseText.read(options.case)
    case = text.case()
    seconds = trial_seconds(case.simulation.steps, options.trials, options.plants, options.schemes)
    expected = {"designing": seconds, "drawing": DRAWING_SECONDS}
    with folder_of(options.out, None if options.json else "barbalat-design") as folder, work(expected) as running:
        with running.part("designing") as progress:
            found = design(
                case,
                sample_time=options.sample_time,
                schemes=options.schemes,
                plants=options.plants,
                trials=options.trials,
                members=options.members,
                seed=options.seed,
                progress=progress,
            )
        document = documents.as_json(found.as_json())
        write_drawn(folder, running, "design.json", document, lambda into: _write(into, found, text))
    tell(document, lambda screen: screens.show(screen, found), folder, as_json=options.json, page=PAGE)
    return 0


def _write(folder: Folder, found: Design, text: CaseText) -> None:
    """Write the page, the case file, the page with sliders and the C. The page names the files that could not be made."""
    from dataclasses import replace

    from barbalat.comparison.design.case_file import with_controller
    from barbalat.explorer.explorer import Explorer
    from barbalat.explorer.source import TextSource
    from barbalat.export.write import export_controller
    from barbalat.report import write
    from barbalat.validate import InputError

    which = "the recommended controller" if found.recommended else "the closest candidate, which does not meet the specification"
    if found.recommended and found.failure(found.recommended):
        which = f"{which}, which meets the specification only under the command of the case"
    said, explorer, written = [], None, None
    try:
        written = with_controller(text, found.controller)
        folder.write(CASE_FILE, written)
        said.append(f"{CASE_FILE}: the case with {which}: {found.controller.name}")
    except InputError as error:
        explorer = f"no case file could be written: {error}"
        said.append(explorer)
    if written is not None:
        try:
            source = TextSource(replace(text, text=written, own=None, dt=found.contest.simulation.dt))
            folder.write("explorer.html", Explorer(source).html)
        except InputError as error:
            explorer = str(error)
    with tempfile.TemporaryDirectory() as made:
        try:
            out = Path(made) / PREFIX
            export_controller(found.case.problem, found.controller, found.case.simulation, out=out, name=PREFIX)
            files = sorted(out.iterdir())
            for file in files:
                folder.write(file.name, file.read_bytes())
            said.append(f"{', '.join(file.name for file in files)}: the controller as C, with a self-test")
        except InputError as error:
            said.append(f"no C was written: {error}")
    write.write_design(folder, found, explorer=explorer, files=said, text=written)
