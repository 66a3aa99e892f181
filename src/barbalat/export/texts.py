"""Pieces of C that several of an export's files share."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from string import Template

import numpy as np

from barbalat import __version__
from barbalat.controllers import SCHEMES, Sampled
from barbalat.controllers.output import OUTPUT_SCHEMES
from barbalat.export.contents import Contents
from barbalat.export.layout import prefix_of
from barbalat.export.parameters import Parameter
from barbalat.lowering import c99

SHORT_NUMBER_LENGTH = 8
"""Longest decimal number that is readable at a glance; a longer one adds nothing to the exact constant."""


@dataclass(frozen=True, eq=False)
class Printed:
    """One export with its names in C.

    prefix  what the functions' names begin with; made of the controller's name where it is empty
    """

    contents: Contents
    prefix: str = ""

    @property
    def name(self) -> str:
        """The prefix of the functions' names."""
        return self.prefix or prefix_of(self.contents.controller.name)

    @property
    def macro(self) -> str:
        """The prefix of the macros' names."""
        return self.name.upper()

    @property
    def real(self) -> str:
        """The type of its numbers."""
        return self.contents.real.name

    @property
    def measured(self) -> str:
        """The paper's symbol for the measurement."""
        return "x" if self.contents.measures_state and self.contents.problem.fixed_observer is None else "y"

    def number(self, value: float) -> str:
        """A constant, exactly, with its decimal form if that is short."""
        text, short = c99.constant(value, self.contents.real), repr(float(value))
        return f"{text} /* {short} */" if len(short) <= SHORT_NUMBER_LENGTH else text

    def parameter(self, wanted: Parameter | float) -> str:
        """C text of a number that may be a parameter of the controller ``c``."""
        if isinstance(wanted, float):
            return c99.constant(wanted, self.contents.real)
        return f"c->parameter[{self.contents.parameters.index(wanted)}]"

    def limit(self, i: int, side: int) -> str:
        """C text of a limit of the i-th input, side 0 for the lower one, where all have some."""
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
        """The program that made the files, and their source."""
        case, each = comment(self.contents.problem.name), f"every {self.contents.sample_time!r} s"
        return (
            f"{comment(self.contents.controller.name)}: {self._scheme}, {each},\n * for the case "
            f"{case}. Made by barbalat {__version__} from the operations of its simulation."
        )

    @property
    def _scheme(self) -> str:
        """The scheme's name in case files; a class from outside has its own."""
        controller = self.contents.controller
        kind = type(controller.controller if isinstance(controller, Sampled) else controller)
        named = {settings: name for name, settings in (*SCHEMES.items(), *OUTPUT_SCHEMES.items())}
        return f"scheme {named[kind]}" if kind in named else f"{kind.__name__} of {kind.__module__}"

    @property
    def guard(self) -> str:
        """Makes a compiler stop if it is given files of two exports."""
        return (
            f"#if {self.macro}_EXPORT != {self.mark}\n"
            '#error "this file and controller.h are from different exports: write the export again"\n#endif\n'
        )


def filled(template: str, /, **given: object) -> str:
    """A file of the folder ``templates`` with its placeholders, ``${like_this}``, filled in."""
    text = (resources.files("barbalat.export") / "templates" / template).read_text("utf-8")
    return Template(text).substitute(given)


def comment(text: str) -> str:
    """Text that can neither end a comment of C nor continue it on the next line."""
    plain = text.encode("ascii", "replace").decode()
    return plain.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/").replace("??", "? ?")


def indented(lines: Iterable[str], by: int = 4) -> str:
    """Each line followed by a newline."""
    return "".join(f"{' ' * by}{line}\n" for line in lines)
