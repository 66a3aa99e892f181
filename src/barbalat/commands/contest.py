"""``barbalat contest`` tunes every scheme by one rule and measures all of them on validation plants."""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING

from barbalat.commands.options import add_controllers, add_list, add_schemes, conclude, trial_seconds, whole
from barbalat.commands.output import folder_of, tell, write_drawn
from barbalat.commands.progress import work

if TYPE_CHECKING:
    from barbalat.commands import Commands


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser(
        "contest", help="tune all schemes by one rule, then compare them on validation plants, commands and noise"
    )
    parser.add_argument(
        "case", nargs="?", metavar="CASE", help="a case file, or a bundled case's name; its plant must have a known set"
    )
    parser.add_argument(
        "--suite", nargs="?", const="", metavar="FILE",
        help="instead of a case, use the frozen public suite, or a suite file of your own with cases, rule and seeds",
    )  # fmt: skip
    add_list(
        parser, "--submission", metavar="WHAT",
        help="entry for the suite: a case file (.toml) with fixed controllers, a file (.py) of laws with tunable parameters, or "
        "an installed scheme",
    )  # fmt: skip
    add_controllers(parser)
    parser.add_argument(
        "--delay-margin", type=float, metavar="S",
        help="added delay that every tuning must tolerate [s]; default: a tenth of the known set's fastest time constant",
    )  # fmt: skip
    parser.add_argument(
        "--gain-margin", type=float, metavar="K",
        help="every tuning must tolerate an input gain that is multiplied or divided by K; default 1.5",
    )  # fmt: skip
    parser.add_argument(
        "--until", choices=("onset", "loss"),
        help="a margin ends where the loop begins to oscillate (onset, default), or where the run diverges or leaves its limits, "
        "or its error has grown by the largest model state (loss)",
    )  # fmt: skip
    add_schemes(parser)
    parser.add_argument(
        "--sample-time",
        type=float,
        metavar="S",
        help="sample time [s] at which all controllers run; default: only controllers that are sampled by definition run sampled",
    )
    parser.add_argument(
        "--noise", type=float, metavar="SHARE",
        help="measurement noise as a fraction of the model's range of motion, if the case has no noise; default 0.001, 0 for "
        "none",
    )  # fmt: skip
    parser.add_argument(
        "--plants",
        type=whole,
        metavar="N",
        help="number of plants for tuning: the case's plant and N - 1 plants of its known set; default 4, or 2 with --quick",
    )
    parser.add_argument(
        "--trials",
        type=whole,
        metavar="N",
        help="maximum number of tunings of each scheme, at least 288; default 384, or 288 with --quick",
    )
    parser.add_argument(
        "--members", type=whole, metavar="N", help="number of validation runs of each scheme; default 200, or 64 with --quick"
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help="use fewer plants, trials and members, which takes a third of the time; with --suite, run only the quick cases",
    )
    parser.add_argument("--seed", type=whole, metavar="S", help="seed of plants, searches, commands and noise; default 0")
    parser.add_argument(
        "--out", metavar="DIR", help="folder for the page and the JSON; default: barbalat-contest, or none with --json"
    )
    conclude(parser, execute)


DRAWING_SECONDS = 2.0
QUICK_SIZES = {"plants": 2, "trials": 288, "members": 64}
"""Values of --quick: the smallest number of trials of the search, and two plants, so that one differs from the plant of the
case."""
FULL_SIZES = {"plants": 4, "trials": 384, "members": 200}


OF_A_CASE = {"delay_margin": None, "gain_margin": 1.5, "until": "onset", "sample_time": None, "noise": 1e-3, "seed": 0}
"""Options of the rule for a case, with their defaults. A suite has a rule of its own."""


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    if options.suite is not None:
        return _suite(options)
    from barbalat.validate import InputError

    if options.case is None:
        raise InputError("contest needs a CASE, or --suite")
    if options.submission:
        raise InputError("--submission needs --suite")
    for name, default in OF_A_CASE.items():
        if vars(options)[name] is None:
            setattr(options, name, default)
    return _case(options)


SUITE_SECONDS = 900.0
"""Time in seconds for all registered schemes on the public suite, on one core."""


def _suite(options: argparse.Namespace) -> int:
    from barbalat.comparison.suite.suite import Submission, Suite, standings
    from barbalat.validate import InputError

    given = [name for name in ("case", "controllers", *OF_A_CASE, *FULL_SIZES) if vars(options)[name] is not None]
    if given:
        which = "CASE" if given[0] == "case" else f"--{given[0].replace('_', '-')}"
        raise InputError(f"{which} cannot be combined with --suite, whose file contains the cases, the rule and the seeds")
    suite = Suite.read(options.suite or None)
    submissions = [Submission.read(one, suite) for one in options.submission]
    with (
        folder_of(options.out, None if options.json else "barbalat-contest") as folder,
        work({"contest": SUITE_SECONDS}) as running,
    ):
        with running.part("contest") as progress:
            found = standings(
                suite, submissions=submissions, schemes=options.schemes, quick=options.quick, processes=os.cpu_count() or 1,
                progress=progress,
            )  # fmt: skip
        from barbalat.report import documents, page

        document = documents.as_json(found.as_json())
        if folder is not None:
            folder.write("suite.json", document)
            folder.write("report.html", page.suite(found))
            folder.commit()
    from barbalat.report import suite as screens
    from barbalat.report.file_names import PAGE

    tell(document, lambda screen: screens.show(screen, found), folder, as_json=options.json, page=PAGE)
    return 0


def _case(options: argparse.Namespace) -> int:
    from barbalat.cases.load import load_case
    from barbalat.comparison.contest.contest import contest

    case = load_case(options.case, options.controllers)
    defaults = QUICK_SIZES if options.quick else FULL_SIZES
    sizes = {name: default if (given := vars(options)[name]) is None else given for name, default in defaults.items()}
    seconds = trial_seconds(case.simulation.steps, sizes["trials"], sizes["plants"], options.schemes)
    expected = {"contest": seconds, "drawing": DRAWING_SECONDS}
    with folder_of(options.out, None if options.json else "barbalat-contest") as folder, work(expected) as running:
        with running.part("contest") as progress:
            found = contest(
                case,
                delay_margin=options.delay_margin,
                gain_margin=options.gain_margin,
                until=options.until,
                schemes=options.schemes,
                sample_time=options.sample_time,
                noise=options.noise,
                seed=options.seed,
                progress=progress,
                **sizes,
            )
        from barbalat.report import documents, write

        document = documents.as_json(found.as_json())
        write_drawn(folder, running, "contest.json", document, lambda into: write.write_contest(into, found))
    from barbalat.report import contest as screens
    from barbalat.report.file_names import PAGE

    tell(document, lambda screen: screens.show(screen, found), folder, as_json=options.json, page=PAGE)
    return 0
