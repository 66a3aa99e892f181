"""What a case file costs to parse, found in one pass over its text before a parser sees it."""

from __future__ import annotations

import re
from dataclasses import dataclass

from barbalat import budget
from barbalat.budget import Estimate
from barbalat.validate import InputError

TEXT_BYTE = Estimate(memory=100.0, seconds=5e-6)
"""Of a case file: the parser takes 0.1 to 1.1 us and up to 27 bytes, and the tables are read three times and checked."""
PART_PAIR = Estimate(memory=4.0, seconds=5e-8)
"""Of a dotted key, times the square of its parts, since each part remembers those before it: 35 MB and 0.1 s for
3,000, and it is read three times."""
MOST_NESTED = 200
"""Lists or tables inside each other: each takes two calls of the parser, and Python allows a thousand."""

TOKEN = re.compile(
    r"""
      (?P<text>\"{3}(?:[^"\\]|\\.|"(?!""))*+(?:"{3}|\Z) | '{3}(?:[^']|'(?!''))*+(?:'{3}|\Z))   # of several lines
    | (?P<part>"(?:[^"\\\n]|\\.)*+" | '[^'\n]*+' | [\w+-]++)                                   # of a key, or a value
    | (?P<dot>[ \t]*+\.[ \t]*+)
    | (?P<open>[\[{]) | (?P<close>[\]}]) | (?P<equal>=)
    | (?P<comment>\#[^\n]*+)
    """,
    re.VERBOSE | re.DOTALL,
)


@dataclass(frozen=True)
class TomlSize:
    """longest  parts of a key; squares: the sum of their squares; equals: keys with a value; nested: levels of brackets"""

    longest: int
    squares: int
    equals: int
    nested: int

    @classmethod
    def of(cls, text: str) -> TomlSize:
        """Counted in one pass; a number with a point counts as two parts, which changes nothing."""
        longest = squares = equals = nested = deepest = parts = 0
        after, joined = -1, False  # where a key that may go on ended, and whether a point followed
        for found in TOKEN.finditer(text):
            kind, begin = found.lastgroup, found.start()
            if kind == "dot":
                joined, after = begin == after, found.end()
                continue
            if kind == "part":
                parts = parts + 1 if joined and begin == after else 1
                squares += 2 * parts - 1  # from (p - 1)^2 to p^2
                longest, after, joined = max(longest, parts), found.end(), False
                continue
            joined = False
            nested += (kind == "open") - (kind == "close")
            deepest = max(deepest, nested)
            equals += kind == "equal"
        return cls(longest, squares, equals, deepest)

    @property
    def pairs(self) -> int:
        """Count the parts that a parser goes through: those of each key, and for each value those of the table in which it
        stands."""
        return self.squares + self.equals * self.longest


def require_readable(text: str, source: str) -> None:
    """InputError for text whose keys or nesting take more than the budget, or more than Python's calls."""
    size = TomlSize.of(text)
    if size.nested > MOST_NESTED:
        raise InputError(f"{source} has {size.nested} lists or tables inside each other; at most {MOST_NESTED} can be read")
    rest = size.pairs - size.longest**2
    budget.require(
        source, size.longest, lambda parts: PART_PAIR.times(parts**2 + rest),
        given=f"has a key of {size.longest} parts with points between them, and to read it",
        fits=lambda parts: f"at most {parts} parts", what=f"reading {source}",
    )  # fmt: skip
