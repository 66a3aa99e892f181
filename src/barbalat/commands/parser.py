"""The command line's parser: what is wrong with what was typed is one sentence, with what is meant where that is near."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from typing import Any, NoReturn

from barbalat.commands.screen import say

BAD_INPUT = 2
"""The exit code."""
REQUIRED = "the following arguments are required: "
UNKNOWN = "unrecognized arguments: "
"""How argparse begins these sentences; the others it begins with the argument that they are about."""
CHOICE = re.compile(r"argument (?P<name>\S+): invalid choice: (?P<given>.+) \(choose from (?P<known>.+)\)$")
NUMBER = re.compile(r"argument (?P<name>\S+): invalid (?P<kind>int|float) value: (?P<given>.+)$")
KINDS = {"int": "a whole number", "float": "a number"}


class Several(argparse.Action):
    """The action of an option with several values, given one after another or by repeating the option; see ``add_list``."""

    def __init__(self, *args: Any, form: str = "", commas: bool = False, **options: Any) -> None:
        super().__init__(*args, **options)
        self.form, self.commas = form, commas

    def __call__(self, _: object, namespace: argparse.Namespace, values: Any, option_string: str | None = None) -> None:
        split = [part.strip() for value in values for part in value.split(",")] if self.commas else values
        setattr(namespace, self.dest, [*getattr(namespace, self.dest), *split])


class Parser(argparse.ArgumentParser):
    """Commands are parsed by it as well."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Parse as argparse does, but let an option with several values leave CASE to the command where it stands nowhere
        else."""
        return super().parse_known_args(args if args is None else self._with_case_first(list(args)), namespace)

    def _with_case_first(self, args: list[str]) -> list[str]:
        """Return the arguments; where an option with several values would swallow CASE, with CASE in front."""
        spare = self._spare(args)
        if not spare:
            return args
        chosen = next((i for i, form in spare if form and not re.search(form, args[i])), spare[-1][0])
        return [args[chosen], *args[:chosen], *args[chosen + 1 :]]

    def _spare(self, args: Sequence[str]) -> list[tuple[int, str]]:
        """Further values of options with several, by their places and forms; none where CASE, or what else is asked, is given."""
        if sum(not action.option_strings for action in self._actions) != 1 or "--" in args:
            return []
        spare: list[tuple[int, str]] = []
        option: argparse.Action | None = None
        taken = 0
        for i, one in enumerate(args):
            if one.startswith("-") and len(one) > 1 and not (option is not None and option.nargs is None and not taken):
                option, taken = self._option(one), int("=" in one)
                if "=" in one or (option is not None and option.nargs == 0):
                    option = None
            elif option is None:
                return []
            else:
                if isinstance(option, Several) and taken:
                    spare.append((i, option.form))
                taken += 1
                option = option if isinstance(option, Several) else None
        return spare

    def _option(self, typed: str) -> argparse.Action | None:
        """Also of a name that is cut short; None where it can't be said."""
        known, name = self._option_string_actions, typed.partition("=")[0]
        meant = {id(action): action for known_name, action in known.items() if known_name.startswith(name)}
        return known[name] if name in known else next(iter(meant.values())) if len(meant) == 1 else None

    def error(self, message: str) -> NoReturn:
        """Say it, without the usage above it, and end the program."""
        say(f"{self.prog}: {self._sentence(message)}")
        raise SystemExit(BAD_INPUT)

    def _sentence(self, message: str) -> str:
        from barbalat.validate import hint

        if message.startswith(REQUIRED):
            return self._missing(message.removeprefix(REQUIRED).split(", "))
        if message.startswith(UNKNOWN):
            given = message.removeprefix(UNKNOWN)
            meant = hint(given.split()[0].partition("=")[0], re.findall(r"--[\w-]+", self.format_help()))
            return f"takes no {given!r}{meant or f'; {self.prog} --help lists what it takes'}"
        if found := CHOICE.match(message):
            known = re.findall(r"[\w.-]+", found["known"])
            meant = hint(found["given"].strip("'\""), known)
            return f"{found['name']} must be one of {', '.join(known)}; got {found['given']}{meant}"
        if found := NUMBER.match(message):
            return f"{found['name']} must be {KINDS[found['kind']]}, got {found['given']}"
        return message.removeprefix("argument ")

    def _missing(self, names: Sequence[str]) -> str:
        if len(names) > 1:
            return f"{', '.join(names[:-1])} and {names[-1]} are missing; {self.prog} --help says what they are"
        action = next(one for one in self._actions if names[0] in (*one.option_strings, one.metavar, one.dest))
        what = f"one of {', '.join(action.choices)}" if action.choices else action.help
        return f"{names[0]} is missing{f': {what}' if what else ''}"
