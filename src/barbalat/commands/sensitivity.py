"""``barbalat sensitivity`` computes how much each number of a case matters: derivatives of the metrics of its runs."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from barbalat.commands.options import add_case, add_list, conclude
from barbalat.commands.output import tell
from barbalat.commands.progress import work

if TYPE_CHECKING:
    from barbalat.commands import Commands


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser(
        "sensitivity", help="find which parameters of a case matter, from derivatives of the metrics of its runs"
    )
    add_case(parser)
    add_list(
        parser, "--of", metavar="METRIC",
        help="metrics of a run, such as rms_e or max_abs_e[0]; default: max_abs_e, rms_e and max_abs_u",
    )  # fmt: skip
    add_list(
        parser, "--to", metavar="PATH",
        help="parameters of the case file, such as plant.theta[0] or controller[0].gamma; default: all nonzero parameters of the "
        "loop. The screen omits definitions, such as the 1 in x1' = x2",
    )  # fmt: skip
    add_list(parser, "--controller", metavar="NAME", help="names of the controllers; default: all")
    parser.add_argument(
        "--redesign", action="store_true",
        help="redesign model and controllers with the plant and its parameters; by default only the simulated plant changes",
    )  # fmt: skip
    conclude(parser, execute)


EXPECTED_SECONDS = {"simulating": 5.0}
"""Estimated seconds until the first report of progress."""


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    from barbalat.cases.load import CaseText
    from barbalat.gradients.sensitivity import sensitivity as computed

    text = CaseText.read(options.case, options.controllers)
    labels = text.case().problem.labels  # errors in the file are reported first
    with work(EXPECTED_SECONDS) as running, running.part("simulating") as progress:
        found = computed(
            text, of=options.of, to=options.to, controllers=options.controller, redesign=options.redesign, progress=progress
        )
    from barbalat.report import documents, sensitivity

    document = documents.as_json(found.as_json())
    tell(document, lambda screen: sensitivity.show(screen, found, labels, named=bool(options.to)), None, as_json=options.json)
    return 0
