"""How a finding follows from what was measured: the rules of docs/claims.md, and nothing else.

A sentence is read literally, once for each thing that it claims; each literal reading holds or fails. Weaker readings are asked only
where every literal one fails.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Finding = Literal["holds", "holds if", "mixed", "fails", "erratum"]
"""What a row can come to; a sentence that is not testable here has no row."""
Verdict = Literal["confirmed", "confirmed with conditions", "not confirmed", "erratum"]
"""The JSON contract's words."""
VERDICTS: dict[Finding, Verdict] = {
    "holds": "confirmed",
    "holds if": "confirmed with conditions",
    "mixed": "confirmed with conditions",
    "fails": "not confirmed",
    "erratum": "erratum",
}
PROPORTIONAL_SHARE = 0.1
"""Twice the one gives twice the other to within this share, in every row and every caption that says *proportional*."""

Role = Literal["literal", "weaker", "mended", "beside"]


@dataclass(frozen=True)
class Source:
    """Who says a sentence.

    key   as in JSON
    name  authors and year
    side  in the dispute, for the totals
    """

    key: str
    name: str
    side: Literal["the critique", "L1's authors", "others", "ours"]


@dataclass(frozen=True)
class Reading:
    """One way to read a sentence: what it then says, whether that was measured to hold, and the number that decides it.

    role  literal; weaker, which supplies the condition of *holds if*; mended, what is printed with an evident mistake put right;
          beside the sentence, measured for the reader's sake and without a part in the finding
    """

    says: str
    holds: bool
    measured: str
    role: Role = "weaker"

    @property
    def literal(self) -> bool:
        return self.role == "literal"

    @property
    def decides(self) -> bool:
        return self.role != "beside"

    @property
    def finding(self) -> Finding:
        return "holds" if self.holds else "fails"


@dataclass(frozen=True, kw_only=True)
class Sentence:
    """A sentence before anything is measured.

    row        the name of its row
    source     who says it
    where      its section
    quote      as printed, short and exact; empty where the text is not at hand, and for statements of our own
    statement  what is tested, in our words
    literal    the literal reading of each thing that it claims
    """

    row: str
    source: Source
    where: str
    quote: str = ""
    statement: str
    literal: tuple[str, ...]

    @property
    def why(self) -> str:
        """What it is: in the table of coverage beside those that have no row."""
        return "measured"

    def reads(self, holds: bool, measured: str, part: int = 0) -> Reading:
        """The result of the literal reading of one of the things that it claims."""
        return Reading(self.literal[part], holds, measured, "literal")


@dataclass(frozen=True, kw_only=True)
class Unmeasured:
    """A sentence of a paper that has no row, or whose row is that of another sentence.

    row   the row that measures it too; None where there is none
    part  which of that row's literal readings it is; None for all of them
    why   what it is instead of a row: a definition, proved here in three lines, not testable because ...
    """

    where: str
    quote: str
    row: str | None = None
    part: int | None = None
    why: str


def finding_of(readings: Sequence[Reading]) -> Finding:
    """The finding on a sentence; ValueError where no reading is literal."""
    literal = {reading.holds for reading in readings if reading.literal}
    if not literal:
        raise ValueError("no reading is literal")
    if len(literal) == 2:
        return "mixed"
    if literal.pop():
        return "holds"
    if any(reading.holds for reading in readings if reading.role == "mended"):
        return "erratum"
    return "holds if" if any(reading.holds for reading in readings if reading.role == "weaker") else "fails"


def condition_of(readings: Sequence[Reading]) -> str:
    """The condition of *holds if*, the first weaker reading that holds; empty for other findings."""
    if finding_of(readings) != "holds if":
        return ""
    return next(reading.says for reading in readings if reading.role == "weaker" and reading.holds)
