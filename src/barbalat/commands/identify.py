"""``barbalat identify``: a nominal plant and its known set from data."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from barbalat.commands.options import add_budget, add_list
from barbalat.commands.output import tell
from barbalat.commands.progress import say, work

if TYPE_CHECKING:
    from barbalat.commands import Commands
    from barbalat.identify.identification import Identification
    from barbalat.report.terminal.layout import Screen


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("identify", help="nominal plant and known set from recorded data")
    parser.add_argument("data", metavar="DATA.csv", help="a line of names, then samples; inputs are held until the next one")
    add_list(parser, "--inputs", metavar="NAME", commas=True, help="columns of the inputs")
    add_list(parser, "--outputs", metavar="NAME", commas=True, help="columns of the states, all of which are measured")
    parser.add_argument("--time", metavar="NAME", help="column of the time [s]; default t or time")
    add_list(
        parser, "--noise", metavar="NAME=BOUND", form="=", commas=True,
        help="bound of each output's measurement error; with --slope the known set follows",
    )  # fmt: skip
    add_list(parser, "--slope", metavar="NAME=BOUND", form="=", commas=True, help="bound of each state's rate of change [unit/s]")
    add_list(
        parser, "--derivative", metavar="NAME=NAME", form="=", commas=True,
        help="outputs whose derivative is another output exactly, such as q=w",
    )  # fmt: skip
    add_list(
        parser, "--within", metavar="STATE.NAME=LOWER:UPPER", form="=", commas=True,
        help="bounds known beforehand of the coefficient of NAME in the row of STATE",
    )  # fmt: skip
    parser.add_argument(
        "--held-out", type=float, default=0.25, metavar="SHARE",
        help="of the samples, the last ones, that the plant is only tried on; default 0.25",
    )  # fmt: skip
    parser.add_argument("--out", metavar="CASE", help="the case file to write, with a picture beside it; default: none")
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    add_budget(parser)
    parser.set_defaults(execute=execute)


EXPECTED = {"identifying": 5.0, "drawing": 1.5}
"""Seconds."""


def execute(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from barbalat.identify.identification import identify
    from barbalat.report import documents

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
                held_out=options.held_out,
            )
        if options.out is not None:
            with running.part("drawing"):
                _write(options.out, found, Path(options.data).name)
    tell(documents.as_json(found.as_json()), partial(_show, found), None, as_json=options.json)
    if options.out is not None:
        say(f"written: {options.out}, a picture beside it; run it with: barbalat run {options.out}")
    return 0


def _show(found: Identification, screen: Screen) -> None:
    from barbalat.report import identification

    identification.show(screen, found)


def _write(out: str, found: Identification, source: str) -> None:
    """The case file and its picture, both or none."""
    from barbalat.folders import output_folder
    from barbalat.identify.case_text import case_text
    from barbalat.identify.picture import draw
    from barbalat.pictures.render import render
    from barbalat.validate import InputError, local_path

    file = local_path("--out", out)
    if file.suffix != ".toml":
        raise InputError(f"--out must be a case file, NAME.toml, got {out!r}")
    text = case_text(found, source)
    with output_folder(file.parent) as folder:
        folder.write(file.name, text)
        folder.write(f"{file.stem}.png", render(draw(found), "png"))
        folder.commit()


def _pairs(option: str, given: list[str]) -> dict[str, str]:
    from barbalat.validate import InputError

    pairs = {}
    for one in given:
        name, equals, value = (part.strip() for part in one.partition("="))
        if not name or not equals or not value or name in pairs:
            raise InputError(f"{option} must be NAME=VALUE, each name once, got {one!r}")
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
