"""The command line, ``barbalat reproduce | run | certify | ...``, a thin layer over the files of the commands."""

from __future__ import annotations

import argparse
import contextlib
import gc
import os
import sys
import warnings
from collections.abc import Sequence

import barbalat
from barbalat.commands import (
    cases,
    certify,
    claims,
    completion,
    contest,
    design,
    explore,
    export,
    fly,
    identify,
    new,
    reproduce,
    run,
    schema,
    sensitivity,
    sweep,
    tradeoff,
    tune,
)
from barbalat.commands.interrupt import Terminated, interruptible
from barbalat.commands.options import BAD_INPUT, UNKNOWN, Parser
from barbalat.commands.progress import say
from barbalat.commands.streams import OutputLost, notes, results

COMMANDS = (
    new,
    cases,
    run,
    certify,
    explore,
    design,
    tune,
    contest,
    tradeoff,
    sweep,
    sensitivity,
    identify,
    export,
    fly,
    claims,
    reproduce,
    schema,
    completion,
)
"""The commands in the order of the help, which is the order in which a new user needs them."""
FAILED, INTERRUPTED, READER_LEFT, TERMINATED = 1, 130, 141, 143
"""Exit codes. The last three are those by which shells report a process ended by SIGINT, SIGPIPE or SIGTERM."""
COLLECT_EVERY = 50_000
"""Number of allocations between two garbage collections, instead of Python's 700. A command makes millions of long-lived objects
(equations, programs, pictures), and scanning them took 5 % of its time."""

SURVIVORS_EVERY = 50
"""After this number of these collections, instead of 10, the survivors of earlier ones are searched again. Most survivors are
modules and classes, and two of these searches took a twentieth of a short command's time."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command. Return the exit code: 0 for success, 2 for bad input, 1 for any other failure."""
    gc.set_threshold(COLLECT_EVERY, SURVIVORS_EVERY)
    with notes():
        try:
            with results():
                return _answered(arguments)
        except OutputLost as lost:
            if lost.reader_left:  # for example ``head`` when it has read enough
                return READER_LEFT
            say(f"barbalat: cannot write to standard output: {lost}")
            return FAILED


def _answered(arguments: Sequence[str] | None) -> int:
    parser = _parser()
    if completion.COMPLETION_VARIABLE in os.environ:
        completion.answer(parser)
    options, unknown = parser.parse_known_args(arguments)
    if unknown:
        options.parser.error(f"{UNKNOWN}{' '.join(unknown)}")
    try:
        with interruptible(), warnings.catch_warnings():
            if not sys.warnoptions:  # overflows are reported in the results, as divergence or as a value that does not apply
                warnings.simplefilter("ignore", RuntimeWarning)
            with _budget(options):
                return int(options.execute(options))
    except OSError as error:  # for example a full disk or a folder that was removed
        say(f"barbalat: cannot write{f' {error.filename!r}' if error.filename else ''}: {error.strerror or error}")
        return FAILED
    except Terminated:
        say("terminated")
        return TERMINATED
    except KeyboardInterrupt:
        say("interrupted")
        # If an interrupt arrives within exec, which dataclasses uses, Python would end itself with the signal. This call prevents
        # that.
        exec("")
        return INTERRUPTED
    except ValueError as error:
        from barbalat.validate import InputError

        if not isinstance(error, InputError):
            raise
        for i, sentence in enumerate(error.sentences):
            say(f"          {sentence}" if i else f"barbalat: {sentence}")
        return BAD_INPUT


def _budget(options: argparse.Namespace) -> contextlib.AbstractContextManager[object]:
    """Apply the requested budget, if the command has the option."""
    if "budget" not in options:
        return contextlib.nullcontext()
    from barbalat.budget import Budget

    return Budget(told=say) if options.budget is None else Budget.parse(options.budget, told=say)


def _parser() -> Parser:
    description = "Design, certify, simulate and deploy adaptive controllers, and find out which claims about them are true."
    parser = Parser(prog="barbalat", description=description)
    parser.add_argument("--version", action="version", version=f"barbalat {barbalat.__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add(commands)
    for own in commands.choices.values():
        own.set_defaults(parser=own)  # a subparser suggests the closest of its own options
    return parser
