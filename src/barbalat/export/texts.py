"""Pieces of C that several files of an export share."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from string import Template
from unicodedata import combining, name, normalize

import numpy as np

from barbalat import __version__
from barbalat.controllers import SCHEMES, Sampled
from barbalat.controllers.output import OUTPUT_SCHEMES
from barbalat.export.contents import Contents
from barbalat.export.layout import prefix_of
from barbalat.export.parameters import Parameter
from barbalat.lowering import c99
from barbalat.problem.tracking import TrackingProblem

SHORT_NUMBER_LENGTH = 8
"""Largest number of characters of a decimal number that is shown beside the exact constant; longer ones are hard to read."""


def command_units(problem: TrackingProblem) -> tuple[str, ...]:
    """For each command the unit of the labelled state that is declared to follow it, else ""; empty without any unit."""
    labels, declared = problem.labels, problem.declared_followers
    units = ["" if labels is None or not labels.units or i is None else labels.units[i] for i in declared]
    return tuple(units) if any(units) else ()


@dataclass(frozen=True, eq=False)
class Printed:
    """One export with its names in C.

    prefix  the beginning of function names; if empty, it is derived from the controller's name
    """

    contents: Contents
    prefix: str = ""

    @property
    def name(self) -> str:
        """The prefix of function names."""
        return self.prefix or prefix_of(self.contents.controller.name)

    @property
    def macro(self) -> str:
        """The prefix of macro names."""
        return self.name.upper()

    @property
    def real(self) -> str:
        """The C type of numbers."""
        return self.contents.real.name

    @property
    def measured(self) -> str:
        """The paper's symbol for the measurement."""
        return "x" if self.contents.measures_state and self.contents.problem.fixed_observer is None else "y"

    def number(self, value: float) -> str:
        """An exact constant, with its decimal form if that is short."""
        text, short = c99.constant(value, self.contents.real), repr(float(value))
        return f"{text} /* {short} */" if len(short) <= SHORT_NUMBER_LENGTH else text

    def parameter(self, wanted: Parameter | float) -> str:
        """C text of a number that may be a parameter of the controller ``c``."""
        if isinstance(wanted, float):
            return c99.constant(wanted, self.contents.real)
        return f"c->parameter[{self.contents.parameters.index(wanted)}]"

    def limit(self, i: int, side: int) -> str:
        """C text of a limit on the i-th input, if all inputs have limits; side 0 is the lower limit."""
        assert self.contents.saturation is not None
        open_one = next((one for one in self.contents.parameters if one.limit == (i, side)), None)
        return self.number(self.contents.saturation[side, i]) if open_one is None else self.parameter(open_one)

    def limits(self) -> list[tuple[int, int]]:
        """The inputs with limits, and the sides 0 and 1 of each."""
        found = self.contents.saturation
        inputs = [] if found is None else np.flatnonzero(np.isfinite(found).all(axis=0)).tolist()
        return [(i, side) for i in inputs for side in (0, 1)]

    @cached_property
    def mark(self) -> str:
        """A number that identifies this export in all its files."""
        vectors = self.contents.vectors
        parts = [repr(self.contents.step).encode(), *(a.tobytes() for a in (vectors.measured, vectors.commands, vectors.states))]
        return f"0x{hashlib.sha256(b''.join([self.name.encode(), self.real.encode(), *parts])).hexdigest()[:8]}UL"

    @property
    def origin(self) -> str:
        """The program that made the files, and their source, for a C comment."""
        return self.told_origin(comment)

    def told_origin(self, written: Callable[[str], str]) -> str:
        """The text on the origin with names in this form."""
        case, each = written(self.contents.problem.name), f"every {self.contents.sample_time!r} s"
        return (
            f"{written(self.contents.controller.name)}: {self._scheme}, {each},\n * for the case "
            f"{case}. Made by barbalat {__version__} from the operations of its simulation."
        )

    @property
    def _scheme(self) -> str:
        """The name of the scheme in case files; for a user-defined class, the class name."""
        controller = self.contents.controller
        kind = type(controller.controller if isinstance(controller, Sampled) else controller)
        named = {settings: name for name, settings in (*SCHEMES.items(), *OUTPUT_SCHEMES.items())}
        return f"scheme {named[kind]}" if kind in named else f"{kind.__name__} of {kind.__module__}"

    @property
    def guard(self) -> str:
        """C text that stops the compiler if it receives files of two exports."""
        return (
            f"#if {self.macro}_EXPORT != {self.mark}\n"
            '#error "this file and controller.h are from different exports: write the export again"\n#endif\n'
        )


def filled(template: str, /, **given: object) -> str:
    """A file of the folder ``templates`` with its placeholders, ``${like_this}``, filled in."""
    text = (resources.files("barbalat.export") / "templates" / template).read_text("utf-8")
    return Template(text).substitute(given)


def comment(text: str) -> str:
    """The text in ASCII, such that it can neither end a C comment nor continue it on the next line."""
    powers = _RAISED.sub(lambda found: f"^{normalize('NFKD', found[0])}", normalize("NFD", text))
    return readable("".join(map(_in_ascii, powers)))


def readable(text: str) -> str:
    """The text with all its characters, for Markdown."""
    return text.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/").replace("??", "? ?")


def comments(texts: Sequence[str], written: Callable[[str], str] = comment) -> list[str]:
    """Each text in this form; if different texts would become equal, the changed characters are written as numbers."""
    found = [written(one) for one in texts]
    meant = {short: {one for one, other in zip(texts, found, strict=True) if other == short} for short in found}
    return [
        short if len(meant[short]) == 1 else written("".join(c if written(c) == c else _number(c) for c in one))
        for one, short in zip(texts, found, strict=True)
    ]


def _in_ascii(character: str) -> str:
    """The letters that replace a character outside ASCII, without its accents; otherwise its number."""
    if character.isascii() or character in _LETTERS:
        return _LETTERS.get(character, character)
    if combining(character):
        return ""
    kind, _, letter = name(character, "").removeprefix("GREEK ").partition(" LETTER ")
    if letter.isalpha() and kind in ("SMALL", "CAPITAL"):
        return letter.lower() if kind == "SMALL" else letter.capitalize()
    plain = normalize("NFKD", character)
    return plain if plain.isascii() else _number(character)


def _number(character: str) -> str:
    return f"(U+{ord(character):04X})"


_RAISED = re.compile("[⁰¹²³⁴-⁹⁺⁻]+")
_LETTERS = {
    "°": "deg", "µ": "u", "Ω": "Ohm", "·": "*", "⋅": "*", "×": "*", "−": "-", "–": "-", "√": "sqrt", "’": "'", "\u0307": "_dot",
    "ß": "ss", "ø": "o", "Ø": "O", "æ": "ae", "Æ": "AE", "ł": "l", "Ł": "L",
}  # fmt: skip
"""Replacements for unit signs, the dot of a derivative, and letters that are not another letter with an accent."""


def indented(lines: Iterable[str], by: int = 4) -> str:
    """The lines, each followed by a newline."""
    return "".join(f"{' ' * by}{line}\n" for line in lines)
