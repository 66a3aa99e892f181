"""``barbalat completion``: shell completion of commands, options and bundled cases."""

from __future__ import annotations

import argparse
import contextlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from barbalat.commands import Commands

SHELLS = ("bash", "zsh", "fish", "tcsh", "powershell")
COMPLETION_VARIABLE = "_ARGCOMPLETE"
"""The environment variable with which a shell requests completions."""


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser(
        "completion", help='print the shell\'s completion script; use it as: eval "$(barbalat completion bash)"'
    )
    parser.add_argument("shell", metavar="SHELL", choices=SHELLS, help=f"one of {', '.join(SHELLS)}")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    from argcomplete.shell_integration import shellcode

    print(shellcode(["barbalat"], shell=options.shell))  # noqa: T201
    return 0


def answer(parser: argparse.ArgumentParser) -> None:
    """Print the possible completions for the shell and end the program."""
    import argcomplete
    from argcomplete.completers import BaseCompleter, FilesCompleter

    class NamesAndFiles(BaseCompleter):
        """Completes matching names, and also files unless only names are possible."""

        def __call__(
            self, *, prefix: str, action: argparse.Action, parser: argparse.ArgumentParser, parsed_args: argparse.Namespace
        ) -> list[str]:
            names = _names(parser.prog.split()[-1], action, parsed_args)
            files = FilesCompleter()(prefix) if names is None or action.metavar == "CASE" else []
            return [*(name for name in names or () if name.startswith(prefix)), *files]

    argcomplete.autocomplete(parser, default_completer=NamesAndFiles())


def _names(command: str, action: argparse.Action, options: argparse.Namespace) -> list[str] | None:
    """Return the possible names: bundled cases, rows of the ledger, flights, or controllers of the named case. None if there are
    none."""
    match command, action.metavar, action.dest:
        case _, "CASE", _:
            from barbalat.cases.bundled import bundled

            return list(bundled())
        case "claims", "NAME", _:
            from barbalat.papers.paper import papers

            return [name for paper in papers().values() for part in paper.ledger for name in part.names]
        case "reproduce", "PAPER", _:
            from barbalat.papers.paper import papers

            return list(papers())
        case "fly", "NAME", "name":
            from barbalat.vehicles.vehicle import vehicles

            return list(vehicles())
        case "export", "NAME", "controller":
            from barbalat.cases.load import load_case

            with contextlib.suppress(ValueError, OSError):  # a case that cannot be read has no names yet
                return [controller.name for controller in load_case(options.case).controllers]
            return []
    return None
