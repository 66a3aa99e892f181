"""``barbalat identify`` finds a nominal plant and its known set from data."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from barbalat.commands.options import add_list, conclude
from barbalat.commands.output import tell
from barbalat.commands.progress import say, work

if TYPE_CHECKING:
    from barbalat.commands import Commands
    from barbalat.identify.result import Identification
    from barbalat.report.terminal.layout import Screen


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("identify", help="find a nominal plant and its known set from recorded data")
    parser.add_argument(
        "data", metavar="DATA.csv",
        help="a CSV file with a header line and one line for each sample; inputs are held between samples",
    )  # fmt: skip
    add_list(parser, "--inputs", metavar="NAME", commas=True, help="columns of the inputs")
    add_list(parser, "--outputs", metavar="NAME", commas=True, help="columns of the states, all of which must be measured")
    parser.add_argument("--time", metavar="NAME", help="column of the time [s]; default t or time")
    add_list(
        parser, "--noise", metavar="NAME=BOUND", form="=", commas=True,
        help="bound on the measurement error of each output; together with --slope it determines the known set",
    )  # fmt: skip
    add_list(
        parser, "--slope", metavar="NAME=BOUND", form="=", commas=True, help="bound on the rate of change of each state [unit/s]"
    )
    add_list(
        parser, "--derivative", metavar="NAME=NAME", form="=", commas=True,
        help="pairs of outputs, such as q=w, in which the derivative of the first is exactly the second",
    )  # fmt: skip
    add_list(
        parser, "--within", metavar="STATE.NAME=LOWER:UPPER", form="=", commas=True,
        help="prior bounds on the coefficient of NAME in the equation of STATE",
    )  # fmt: skip
    parser.add_argument(
        "--offset", action="store_true",
        help="identify a constant term in each unknown equation, for recordings around an operating point",
    )  # fmt: skip
    parser.add_argument(
        "--delay", type=float, default=0.0, metavar="SECONDS", help="dead time of the inputs, a multiple of the sample time"
    )
    parser.add_argument(
        "--held-out", type=float, default=0.25, metavar="SHARE",
        help="fraction of the samples, at the end of the recording, that is used only for validation; default 0.25",
    )  # fmt: skip
    parser.add_argument(
        "--out", metavar="FILE",
        help="the case file to write, with a page and a picture in the same folder; with --replay, the page to write, NAME.html",
    )  # fmt: skip
    parser.add_argument(
        "--replay", metavar="CASE",
        help="instead of identifying a plant, run the recording through the estimators of this case's sampled controllers",
    )  # fmt: skip
    add_list(parser, "--commands", metavar="NAME", commas=True, help="with --replay: columns of the commands")
    conclude(parser, execute)


EXPECTED = {"identifying": 5.0, "drawing": 1.5}
"""Expected duration of each part [s]."""
OF_IDENTIFICATION = ("noise", "slope", "derivative", "within", "offset", "delay")
"""Options that a replay does not use."""


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    from barbalat.identify.identification import identify
    from barbalat.report import documents
    from barbalat.validate import InputError

    if options.replay is not None:
        return _replay(options)
    if options.commands:
        raise InputError("--commands needs --replay, which is missing")
    with work(EXPECTED) as running:
        with running.part("identifying"):
            found = identify(
                options.data,
                options.inputs,
                options.outputs,
                time=options.time,
                noise=_numbers("--noise", options.noise),
                slope=_numbers("--slope", options.slope),
                derivatives=_pairs("--derivative", options.derivative),
                within=_within(options.within),
                offset=options.offset,
                delay=options.delay,
                held_out=options.held_out,
            )
        if options.out is not None:
            with running.part("drawing"):
                _write(options.out, found, Path(options.data).name)
    tell(documents.as_json(found.as_json()), partial(_show, found), None, as_json=options.json)
    if options.out is not None:
        say(f"written: {options.out}, with a page and its picture in the same folder; run it with: barbalat run {options.out}")
    return 0


def _replay(options: argparse.Namespace) -> int:
    """Run the recording through the estimators of a case. Return the exit code."""
    import numpy as np

    from barbalat.cases.load import load_case
    from barbalat.folders import output_folder
    from barbalat.identify.recording import read_csv
    from barbalat.problem.state_feedback import Problem
    from barbalat.report import documents, replayed
    from barbalat.report.write import write_replay
    from barbalat.study.replay import replay_case
    from barbalat.validate import InputError

    for name in OF_IDENTIFICATION:
        if getattr(options, name):
            raise InputError(f"--{name} applies only to an identification, but --replay identifies nothing")
    if not options.commands:
        raise InputError("--replay needs --commands, the columns of the commands that were flown")
    case = load_case(options.replay)
    if not isinstance(case.problem, Problem):
        raise InputError("--replay is for state feedback, but this case feeds back an output")
    columns = [*options.outputs, *options.commands]
    recording = read_csv(options.data, options.inputs, columns, options.time)
    y, r = np.split(recording.outputs, [len(options.outputs)], axis=1)
    page = None if options.out is None else _file(options.out, ".html", "a page, NAME.html")
    with work({"replaying": 2e-3 * len(recording.times)} | ({"drawing": 3.0} if page else {})) as running:
        with running.part("replaying"):
            found = replay_case(case.problem, case.controllers, recording.times, y, recording.inputs, r)
        if page is not None:
            with running.part("drawing"), output_folder(page.parent) as folder:
                write_replay(folder, found, case.problem, stem=page.stem, source=Path(options.data).name, case=options.replay)
                folder.commit()
    told = {"data": options.data, "case": case.problem.name, **replayed.as_json(found, case.problem)}
    tell(documents.as_json(told), partial(replayed.show, found, case.problem), None, as_json=options.json)
    if page is not None:
        say(f"written: {page}, with its picture in the same folder")
    return 0


def _file(out: str, suffix: str, what: str) -> Path:
    """Return the file to write. Raises InputError for a different kind of file."""
    from barbalat.validate import InputError, local_path

    file = local_path("--out", out)
    if file.suffix != suffix:
        raise InputError(f"--out must be {what}, got {out!r}")
    return file


def _show(found: Identification, screen: Screen) -> None:
    from barbalat.report import identification

    identification.show(screen, found)


def _write(out: str, found: Identification, source: str) -> None:
    """Write the case file with its page and its picture, or nothing."""
    from barbalat.folders import output_folder
    from barbalat.identify.case_text import case_text
    from barbalat.report.write import write_identification

    file = _file(out, ".toml", "a case file, NAME.toml")
    text = case_text(found, source)
    with output_folder(file.parent) as folder:
        folder.write(file.name, text)
        write_identification(folder, found, stem=file.stem, source=source, text=text)
        folder.commit()


def _pairs(option: str, given: list[str]) -> dict[str, str]:
    from barbalat.validate import InputError

    pairs = {}
    for one in given:
        name, equals, value = (part.strip() for part in one.partition("="))
        if not name or not equals or not value or name in pairs:
            raise InputError(f"{option} must be NAME=VALUE, with each name once, got {one!r}")
        pairs[name] = value
    return pairs


def _numbers(option: str, given: list[str]) -> dict[str, float] | None:
    from barbalat.validate import InputError

    found = {}
    for name, value in _pairs(option, given).items():
        try:
            found[name] = float(value)
        except ValueError:
            raise InputError(f"{option} {name} must be a number, got {value!r}") from None
    return found or None


def _within(given: list[str]) -> dict[tuple[str, str], tuple[float, float]]:
    from barbalat.validate import InputError

    found = {}
    for path, ends in _pairs("--within", given).items():
        state, point, name = path.partition(".")
        low, colon, high = ends.partition(":")
        try:
            if not point or not colon:
                raise ValueError(ends)
            found[state, name] = float(low), float(high)
        except ValueError:
            raise InputError(f"--within must be STATE.NAME=LOWER:UPPER, got {path + '=' + ends!r}") from None
    return found
