"""Options that several commands share."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

from barbalat.commands.progress import say

if TYPE_CHECKING:
    from barbalat.open_numbers.path import FieldPath

Values = TypeVar("Values")


def add_budget(parser: argparse.ArgumentParser) -> None:
    """Add the option for limits on memory and time."""
    parser.add_argument(
        "--budget",
        type=_limits,
        metavar="LIMITS",
        help="limits on the estimated memory and the time on one core, such as 16GiB, 5h or 16GiB,5h; default: 4GiB,1h. "
        "Larger jobs are not started",
    )


def _limits(text: str) -> str:
    if any(part.strip().startswith("-") for part in text.split(",")):
        raise argparse.ArgumentTypeError(f"must be a positive memory, a positive time or both, such as 16GiB,5h, got {text!r}")
    return text


MOST_DIGITS = 40
"""Largest number of digits of a whole number, which is enough for any seed and any count."""


def whole(text: str) -> int:
    """Parse an option's whole number, which may be written as 1e6."""
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
    """Add the option for the user's own controllers."""
    parser.add_argument(
        "--controllers",
        type=Path,
        metavar="FILE.py",
        help="run this file and add its own controllers to those of the case: the list CONTROLLERS or, without that list, all "
        'controllers that it creates. The case may use its classes by name, as in scheme = "MyLaw"',
    )


def add_case(parser: argparse.ArgumentParser) -> None:
    """Add the case and the option for the user's own controllers."""
    parser.add_argument("case", metavar="CASE", help="a case file, or a bundled case's name")
    add_controllers(parser)


def conclude(parser: argparse.ArgumentParser, execute: Callable[[argparse.Namespace], int]) -> None:
    """Add the last options of a command, and the function that runs it."""
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    add_budget(parser)
    parser.set_defaults(execute=execute)


def add_list(parser: argparse.ArgumentParser, *names: str, metavar: str, help: str, form: str = "", commas: bool = False) -> None:
    """Add an option with several values, given in sequence or by repeating the option. The default is an empty list.

    form    a regular expression that matches each value and rarely anything else
    commas  whether values may also be separated by commas
    """
    said = "give several values or repeat the option"
    parser.add_argument(
        *names, action=Several, nargs="+", default=[], metavar=metavar, help=f"{help}; {said}", form=form, commas=commas
    )


def pair(given: str, taken: str) -> tuple[str, str]:
    """Split PATH=VALUES into its two sides. ``taken`` describes the values of the option for the error message."""
    path, sign, values = given.partition("=")
    if not sign:
        from barbalat.validate import InputError, show

        raise InputError(f"{taken}, got {show(given)}")
    return path.strip(), values.strip()


def varied(pairs: Iterable[tuple[str, str]], parse: Callable[[str], Values]) -> dict[FieldPath, Values]:
    """Return the values of ``--vary`` by their paths. Raises InputError for a path that occurs twice."""
    from barbalat.open_numbers.path import FieldPath
    from barbalat.validate import InputError

    found: dict[FieldPath, Values] = {}
    for place, values in pairs:
        path = FieldPath.parse(place)
        if path in found:
            raise InputError(f"{path} is varied twice")
        try:
            found[path] = parse(values)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
    return found


BAD_INPUT = 2
"""Exit code for bad input."""
REQUIRED = "the following arguments are required: "
UNKNOWN = "unrecognized arguments: "
"""The beginning of these messages of argparse. Its other messages begin with the argument that they concern."""
CHOICE = re.compile(r"argument (?P<name>\S+): invalid choice: (?P<given>.+) \(choose from (?P<known>.+)\)$")
NUMBER = re.compile(r"argument (?P<name>\S+): invalid (?P<kind>whole|float) value: (?P<given>.+)$")
SENTENCE = re.compile(r"^argument (\S+): must be")
"""The beginning of argparse's message if an option's type rejects a value."""
KINDS = {"whole": "a whole number", "float": "a number"}
VALUE = re.compile(r"-\.?\d")
"""Start of an argument that is a negative value, such as -1e3 or -1GiB, and not an option."""


class Several(argparse.Action):
    """The action of an option with several values, given in sequence or by repeating the option; see ``add_list``."""

    def __init__(self, *args: Any, form: str = "", commas: bool = False, **options: Any) -> None:
        super().__init__(*args, **options)
        self.form, self.commas = form, commas

    def __call__(self, _: object, namespace: argparse.Namespace, values: Any, option_string: str | None = None) -> None:
        split = [part.strip() for value in values for part in value.split(",")] if self.commas else values
        setattr(namespace, self.dest, [*getattr(namespace, self.dest), *split])


class Parser(argparse.ArgumentParser):
    """The parser of the program and of its commands."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._negative_number_matcher = VALUE  # the pattern of argparse recognises only -1 and -1.5

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Parse as argparse does, except that an option with several values does not take CASE if it is given nowhere
        else."""
        given = list(sys.argv[1:] if args is None else args)
        self._require_known_options(given)
        return super().parse_known_args(self._with_case_first(given), namespace)

    def _require_known_options(self, args: Sequence[str]) -> None:
        """End the program at an option with an unknown name, before argparse reports what is missing because of it."""
        known = self._option_string_actions
        for one in args:
            name = one.partition("=")[0]
            if name == "--" or name in ("-h", "--help") or (self._subparsers is not None and not one.startswith("-")):
                return  # what follows is no option, is not read, or belongs to a command
            is_option = one.startswith("-") and len(one) > 1 and " " not in one and not VALUE.match(one)
            if is_option and not any(option.startswith(name) for option in known):
                from barbalat.validate import nearest

                near = nearest(name.lstrip("-"), (option.lstrip("-") for option in known))
                self.error(f"unknown option {name}; {f'did you mean --{near}?' if near else f'{self.prog} --help lists them'}")

    def _with_case_first(self, args: list[str]) -> list[str]:
        """Return the arguments, with CASE in front if an option with several values would take it."""
        spare = self._spare(args)
        if not spare:
            return args
        chosen = next((i for i, form in spare if form and not re.search(form, args[i])), spare[-1][0])
        return [args[chosen], *args[:chosen], *args[chosen + 1 :]]

    def _spare(self, args: Sequence[str]) -> list[tuple[int, str]]:
        """Return the further values of options with several values, with their positions and forms; none if CASE or other
        required arguments are given."""
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
        """Return the option for a name, which may be abbreviated; None if it is ambiguous."""
        known, name = self._option_string_actions, typed.partition("=")[0]
        meant = {id(action): action for known_name, action in known.items() if known_name.startswith(name)}
        return known[name] if name in known else next(iter(meant.values())) if len(meant) == 1 else None

    def error(self, message: str) -> NoReturn:
        """Print the message without the usage and end the program."""
        say(f"{self.prog}: {self._sentence(message)}")
        raise SystemExit(BAD_INPUT)

    def _sentence(self, message: str) -> str:
        from barbalat.validate import hint

        if message.startswith(REQUIRED):
            return self._missing(message.removeprefix(REQUIRED).split(", "))
        if message.startswith(UNKNOWN):
            return f"does not know {message.removeprefix(UNKNOWN)!r}; {self.prog} --help lists its arguments"
        if found := CHOICE.match(message):
            known = re.findall(r"[\w.-]+", found["known"])
            meant = hint(found["given"].strip("'\""), known)
            return f"{found['name']} must be one of {', '.join(known)}; got {found['given']}{meant}"
        if found := NUMBER.match(message):
            return f"{found['name']} must be {KINDS[found['kind']]}, got {found['given']}"
        return SENTENCE.sub(r"\1 must be", message).removeprefix("argument ")

    def _missing(self, names: Sequence[str]) -> str:
        if len(names) > 1:
            return f"{', '.join(names[:-1])} and {names[-1]} are missing; {self.prog} --help describes them"
        action = next(one for one in self._actions if names[0] in (*one.option_strings, one.metavar, one.dest))
        what = f"one of {', '.join(action.choices)}" if action.choices else action.help
        if isinstance(action, argparse._SubParsersAction):
            what = f"{what}; {self.prog} --help describes them"
        return f"{names[0]} is missing{f': {what}' if what else ''}"


MOST_SCHEMES = 9
"""The schemes that can be tuned."""


def add_schemes(parser: argparse.ArgumentParser) -> None:
    """Add the option for the schemes that are compared."""
    add_list(
        parser,
        "--schemes",
        metavar="NAME",
        commas=True,
        help="schemes, named as in case files; default: all tunable schemes",
    )


def trial_seconds(steps: int, trials: int, plants: int, schemes: Sequence[str]) -> float:
    """Return the expected time of a comparison with this number of tunings of each scheme, for its progress [s]."""
    from barbalat.comparison.contest.contest import search_seconds

    return max(search_seconds(steps, len(schemes) or MOST_SCHEMES, trials, plants), 1.0)
