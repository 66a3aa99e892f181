"""``barbalat tune`` finds settings of the controllers of a case that minimise a quantity under constraints."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from barbalat.commands.options import add_case, add_list, conclude, pair, varied, whole
from barbalat.commands.output import folder_of, tell, write_drawn
from barbalat.commands.progress import SECONDS_EACH_STEP, work

if TYPE_CHECKING:
    from barbalat.commands import Commands
    from barbalat.comparison.ranges import Space


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser(
        "tune", help="find settings that give a small error under constraints, and write them to a case file"
    )
    add_case(parser)
    parser.add_argument(
        "--for", dest="objective", required=True, metavar="METRIC",
        help="the quantity to minimise: a metric of a run, such as rms_e, or a key of certify",
    )  # fmt: skip
    parser.add_argument("--maximize", action="store_true", help="maximise the quantity instead")
    add_list(
        parser, "--subject-to", metavar="REQUIREMENT", form="[<>]",
        help='such as "delay_margin_measured >= 0.02", "gain_margin_measured >= 1.5", "condition < 1" (L1), "max_abs_u < 9"; '
        "delay_margin is that of the loop with frozen estimates, on which the gain of MRAC has no influence; "
        "delay_margin_adapting is that of the linear loop including the law; neither accounts for input limits or a changing "
        "command",
    )  # fmt: skip
    add_list(
        parser, "--vary", metavar="PATH=START:STOP[:log]", form="=",
        help="a parameter of the case file to tune; default: the tunable settings of each controller's scheme",
    )  # fmt: skip
    parser.add_argument("--controller", metavar="NAME", help="the controller to tune; default: all, one after the other")
    parser.add_argument(
        "--plants",
        type=whole,
        default=4,
        metavar="N",
        help="number of plants: the case's plant and N - 1 plants of its known set; default 4",
    )
    parser.add_argument(
        "--quantile",
        type=float,
        default=1.0,
        metavar="Q",
        help="quantile over the plants, between 0 and 1; default 1, the worst plant",
    )
    parser.add_argument(
        "--trials",
        type=whole,
        metavar="N",
        help="number of tunings tried for each controller: default 384, minimum 288; with more than three tuned parameters, "
        "default and minimum are 576",
    )
    parser.add_argument("--seed", type=whole, default=0, metavar="S", help="seed for the plants and the search; default 0")
    parser.add_argument(
        "--out",
        metavar="DIR",
        help="folder for the case file, the page and the JSON; default: barbalat-tune, or none with --json",
    )
    conclude(parser, execute)


DRAWING_SECONDS = 3.0
TAKEN = "--vary takes PATH=START:STOP[:log], such as controller[0].gamma=1:1000:log"


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    from barbalat.cases.load import CaseText
    from barbalat.comparison.search.aim import Aim
    from barbalat.comparison.tune.tune import DEFAULT_TRIALS, RUNS_EACH_TRIAL, Tuner, tune_case
    from barbalat.open_numbers.path import by_index

    text = CaseText.read(options.case, options.controllers)
    case = text.case()
    aim = Aim.of(
        options.objective,
        options.subject_to,
        maximize=options.maximize,
        plants=options.plants,
        quantile=options.quantile,
        seed=options.seed,
        labels=case.problem.labels,
    )
    space, tuner = _space([by_index(one, case.problem.labels) for one in options.vary]), Tuner(text, case, aim, options.trials)
    trials = DEFAULT_TRIALS if options.trials is None else options.trials
    steps = case.simulation.steps * trials * RUNS_EACH_TRIAL * options.plants * len(case.controllers)
    expected = {"tuning": max(steps * SECONDS_EACH_STEP, 1.0), "drawing": DRAWING_SECONDS}
    with folder_of(options.out, None if options.json else "barbalat-tune") as folder, work(expected) as running:
        with running.part("tuning") as progress:
            found = tune_case(tuner, space, controller=options.controller, progress=progress)
        from barbalat.report import documents, write

        document = documents.as_json(found.as_json())
        write_drawn(folder, running, "tune.json", document, lambda into: write.write_tuning(into, found))
    from barbalat.report import tuning
    from barbalat.report.file_names import PAGE, TUNED_CASE

    tell(document, lambda screen: tuning.show(screen, found), folder, as_json=options.json, case=TUNED_CASE, page=PAGE)
    return 0


def _space(given: list[str]) -> Space | None:
    """Return the ranges of ``--vary``, or None if it is not given."""
    from barbalat.comparison.ranges import Range, Space

    ranges = varied([pair(one, TAKEN) for one in given], Range.parse)
    return Space(ranges) if ranges else None
