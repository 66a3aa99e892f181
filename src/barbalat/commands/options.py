"""Options that several commands share."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any, NoReturn

from barbalat.commands.progress import say


def add_budget(parser: argparse.ArgumentParser) -> None:
    """How much work may be begun."""
    parser.add_argument(
        "--budget",
        type=_limits,
        metavar="LIMITS",
        help="memory and time of one core that work may take by its estimate before it is begun, such as 16GiB, 5h or 16GiB,5h; "
        "default: 4GiB,1h",
    )


def _limits(text: str) -> str:
    if any(part.strip().startswith("-") for part in text.split(",")):
        raise argparse.ArgumentTypeError(f"must be a positive memory, a positive time or both, such as 16GiB,5h, got {text!r}")
    return text


MOST_DIGITS = 40
"""Of a whole number: as many as any seed needs, and more than any count."""


def whole(text: str) -> int:
    """The type of an option that takes a whole number, which may be written as 1e6."""
    try:
        number = Decimal(text)
    except InvalidOperation:
        raise ValueError(text) from None
    if not number.is_finite() or number != number.to_integral_value():
        raise ValueError(text)
    if number.adjusted() >= MOST_DIGITS:
        from barbalat.validate import show

        raise argparse.ArgumentTypeError(f"must be a whole number of at most {MOST_DIGITS} digits, got {show(text)}")
    return int(number)


def add_controllers(parser: argparse.ArgumentParser) -> None:
    """Classes of the user's own."""
    parser.add_argument(
        "--controllers",
        type=Path,
        metavar="FILE.py",
        help="controllers of your own beside the case's: this file is run, and its list CONTROLLERS joins them, or else all "
        'controllers made in it; the case may name its classes, as scheme = "MyLaw"',
    )


def add_list(parser: argparse.ArgumentParser, *names: str, metavar: str, help: str, form: str = "", commas: bool = False) -> None:
    """An option with several values: after one another, or each after the option once more; an empty list without it.

    form    a regular expression that is found in each value, and hardly in anything else
    commas  whether values may also stand with commas between
    """
    said = "several, or the option again, for more"
    parser.add_argument(
        *names, action=Several, nargs="+", default=[], metavar=metavar, help=f"{help}; {said}", form=form, commas=commas
    )


BAD_INPUT = 2
"""The exit code."""
REQUIRED = "the following arguments are required: "
UNKNOWN = "unrecognized arguments: "
"""How argparse begins these sentences; the others it begins with the argument that they are about."""
CHOICE = re.compile(r"argument (?P<name>\S+): invalid choice: (?P<given>.+) \(choose from (?P<known>.+)\)$")
NUMBER = re.compile(r"argument (?P<name>\S+): invalid (?P<kind>whole|float) value: (?P<given>.+)$")
SENTENCE = re.compile(r"^argument (\S+): must be")
"""How argparse begins what an option's type says of a value."""
KINDS = {"whole": "a whole number", "float": "a number"}
VALUE = re.compile(r"-\.?\d")
"""How an argument begins that is a value with a minus, such as -1e3 or -1GiB, and no option."""


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

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._negative_number_matcher = VALUE  # argparse's own knows -1 and -1.5

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
        return SENTENCE.sub(r"\1 must be", message).removeprefix("argument ")

    def _missing(self, names: Sequence[str]) -> str:
        if len(names) > 1:
            return f"{', '.join(names[:-1])} and {names[-1]} are missing; {self.prog} --help says what they are"
        action = next(one for one in self._actions if names[0] in (*one.option_strings, one.metavar, one.dest))
        what = f"one of {', '.join(action.choices)}" if action.choices else action.help
        return f"{names[0]} is missing{f': {what}' if what else ''}"
