"""``barbalat completion``: what makes a shell complete commands, options and bundled cases."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from barbalat.commands import Commands

SHELLS = ("bash", "zsh", "fish", "tcsh", "powershell")
COMPLETION_VARIABLE = "_ARGCOMPLETE"
"""The environment variable by which a shell says that it wants completions."""


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser(
        "completion", help='print what makes a shell complete, to be used as: eval "$(barbalat completion bash)"'
    )
    parser.add_argument("shell", metavar="SHELL", choices=SHELLS, help=f"one of {', '.join(SHELLS)}")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from argcomplete.shell_integration import shellcode

    print(shellcode(["barbalat"], shell=options.shell))  # noqa: T201
    return 0


def answer(parser: argparse.ArgumentParser) -> None:
    """Tell the shell that asked what may come next, and end the program."""
    import argcomplete
    from argcomplete.completers import BaseCompleter, FilesCompleter

    from barbalat.cases.bundled import bundled

    class CasesAndFiles(BaseCompleter):
        """The bundled cases where a case is meant, and files."""

        def __call__(
            self, *, prefix: str, action: argparse.Action, parser: argparse.ArgumentParser, parsed_args: argparse.Namespace
        ) -> list[str]:
            names = [name for name in bundled() if name.startswith(prefix)] if action.metavar == "CASE" else []
            return [*names, *FilesCompleter()(prefix)]

    argcomplete.autocomplete(parser, default_completer=CasesAndFiles())
