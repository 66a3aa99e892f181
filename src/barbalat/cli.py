"""The command line: ``barbalat reproduce | run | certify | tradeoff | cases | new``, a thin layer over the commands' files."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

import barbalat
from barbalat.commands import cases, certify, new, reproduce, run, tradeoff
from barbalat.commands.screen import say

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code: 0 done, 2 bad input, 1 anything else that went wrong."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.execute(options))
    except BrokenPipeError:  # the reader, say ``head``, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except KeyboardInterrupt:
        say("interrupted")
        return INTERRUPTED
    except ValueError as error:
        from barbalat.validate import InputError

        if not isinstance(error, InputError):
            raise
        say(f"barbalat: {error}")
        return BAD_INPUT


def _parser() -> argparse.ArgumentParser:
    description = "Design, certify, simulate adaptive controllers, and find out which claims about them are true."
    parser = argparse.ArgumentParser(prog="barbalat", description=description)
    parser.add_argument("--version", action="version", version=f"barbalat {barbalat.__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in (reproduce, run, certify, tradeoff, cases, new):
        command.add(commands)
    return parser
