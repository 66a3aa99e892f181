"""The command line's parser: what is wrong with what was typed is one sentence, with what is meant where that is near."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from typing import NoReturn

from barbalat.commands.screen import say

BAD_INPUT = 2
"""The exit code."""
REQUIRED = "the following arguments are required: "
UNKNOWN = "unrecognized arguments: "
"""How argparse begins these sentences; the others it begins with the argument that they are about."""
CHOICE = re.compile(r"argument (?P<name>\S+): invalid choice: (?P<given>.+) \(choose from (?P<known>.+)\)$")
NUMBER = re.compile(r"argument (?P<name>\S+): invalid (?P<kind>int|float) value: (?P<given>.+)$")
KINDS = {"int": "a whole number", "float": "a number"}


class Parser(argparse.ArgumentParser):
    """Commands are parsed by it as well."""

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
