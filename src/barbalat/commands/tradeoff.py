"""``barbalat tradeoff`` plots tracking error against delay margin for many tunings of three schemes and of the user's schemes."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from typing import TYPE_CHECKING

from barbalat.commands.options import add_case, conclude, whole
from barbalat.commands.output import folder_of, tell, write_drawn
from barbalat.commands.progress import Work, work

if TYPE_CHECKING:
    from barbalat.cases.build import Case
    from barbalat.commands import Commands
    from barbalat.comparison.tradeoff.tradeoff import TradeOff
    from barbalat.report.terminal.layout import Screen


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser(
        "tradeoff", help="plot tracking error against delay margin for many tunings of three schemes and of your own controllers"
    )
    add_case(parser)
    parser.add_argument("--out", metavar="DIR", help="default: barbalat-tradeoff, or none with --json")
    parser.add_argument(
        "--plants",
        type=whole,
        default=4,
        metavar="N",
        help="number of plants: the case's plant and N - 1 plants of its known set; default 4",
    )
    parser.add_argument(
        "--density",
        type=whole,
        default=6,
        metavar="N",
        help="number of values per setting; default 6, which takes under a minute (12 takes four times as long)",
    )
    parser.add_argument(
        "--share",
        type=float,
        default=1.0,
        metavar="S",
        help="a run also counts as lost when the delay increases the largest error in the tail by S times the largest "
        "model state; default 1",
    )
    conclude(parser, execute)


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    from barbalat import validate
    from barbalat.cases.load import load_case

    started = time.perf_counter()
    case = load_case(options.case, options.controllers)
    validate.whole("--density", options.density, least=2)
    validate.whole("--plants", options.plants, least=1)
    default = None if options.json else "barbalat-tradeoff"
    with folder_of(options.out, default) as folder, work(EXPECTED_SECONDS) as running:
        found = _found(case, options, running)
        from barbalat.report import documents, tradeoff, write

        found = replace(found, seconds=time.perf_counter() - started)
        document = documents.as_json(tradeoff.as_document(found))
        write_drawn(folder, running, "tradeoff.json", document, lambda into: write.write_tradeoff(into, found))
    seconds = time.perf_counter() - started

    def show(screen: Screen) -> None:
        tradeoff.show(screen, found)
        screen.line(f"{found.runs} simulations of {case.simulation.t_end:g} s; {seconds:.0f} s in all, including pictures")

    from barbalat.report.file_names import PAGE

    tell(document, show, folder, as_json=options.json, page=PAGE)
    return 0


EXPECTED_SECONDS = {"simulating": 60.0, "drawing": 3.0}
"""Estimated seconds until the first report of progress."""


def _found(case: Case, options: argparse.Namespace, running: Work) -> TradeOff:
    from barbalat.comparison.tradeoff.tradeoff import trade_off
    from barbalat.loop.structure import comes_from_outside
    from barbalat.problem.state_feedback import Problem
    from barbalat.study.resolved import resolved
    from barbalat.study.verdicts import Lost
    from barbalat.targets import TRADE_OFF

    TRADE_OFF.require(case.problem)
    assert isinstance(case.problem, Problem)
    with running.part("simulating") as progress:
        return trade_off(
            case.problem,
            resolved(case.problem, case.controllers, case.simulation),
            density=options.density,
            own=[one for one in case.controllers if comes_from_outside(one)],
            plants=options.plants,
            judge=case.judge,
            lost=Lost(share=options.share),
            progress=progress,
        )
