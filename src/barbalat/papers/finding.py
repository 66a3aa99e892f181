"""Derives a finding from the measurements, by the rules of docs/claims.md only.

A sentence has one literal reading for each of its claims, and each literal reading holds or fails. Weaker readings count only
if every literal reading fails.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Finding = Literal["holds", "holds if", "mixed", "fails", "erratum"]
"""The possible findings of a row. A sentence that is not testable here has no row."""
Verdict = Literal["confirmed", "confirmed with conditions", "not confirmed", "erratum"]
"""The words that the JSON contract uses for the findings."""
VERDICTS: dict[Finding, Verdict] = {
    "holds": "confirmed",
    "holds if": "confirmed with conditions",
    "mixed": "confirmed with conditions",
    "fails": "not confirmed",
    "erratum": "erratum",
}
PROPORTIONAL_SHARE = 0.1
"""*Proportional* means in every row and caption that twice the cause gives twice the effect to within this fraction."""

Role = Literal["literal", "weaker", "mended", "beside"]


@dataclass(frozen=True)
class Source:
    """The source of a sentence.

    key   as in JSON
    name  authors and year
    side  its side in the dispute, used in the totals
    """

    key: str
    name: str
    side: Literal["the critique", "L1's authors", "others", "ours"]


@dataclass(frozen=True)
class Reading:
    """One reading of a sentence: its statement, whether the measurement confirms it, and the deciding number.

    role  *literal*, *weaker*, *mended* or *supplementary*. A weaker reading supplies the condition of *holds if*, a mended one is
          the printed sentence with an obvious mistake corrected, and a supplementary one is measured for information and does not
          influence the finding
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
class Change:
    """A change of a row after it had been measured.

    date    as YYYY-MM-DD
    before  the finding before the change; None if the row is new
    after   the finding after the change
    what    what was changed, and why
    """

    date: str
    before: Finding | None
    after: Finding
    what: str

    @property
    def findings(self) -> str:
        """The findings before and after the change, in words."""
        return f"still {self.after}" if self.before == self.after else f"{self.before or 'new'} to {self.after}"


@dataclass(frozen=True, kw_only=True)
class Sentence:
    """A sentence with its literal readings. Only ``changed`` depends on a measurement.

    row        the name of its row
    source     its source
    where      its section
    quote      as printed, short and exact; empty if the text is not available, and for statements by this project
    statement  the tested statement in this project's words
    literal    the literal reading of each of its claims
    equation   the paper's equations that the row tests or runs; empty if there are none
    changed    the changes after the row had been measured, oldest first
    """

    row: str
    source: Source
    where: str
    quote: str = ""
    statement: str
    literal: tuple[str, ...]
    equation: str = ""
    changed: tuple[Change, ...] = ()

    @property
    def why(self) -> str:
        """The entry for the sentence in the table of coverage, which also lists sentences without a row."""
        return "measured"

    def reads(self, holds: bool, measured: str, part: int = 0) -> Reading:
        """Return the result of one of the sentence's literal readings."""
        return Reading(self.literal[part], holds, measured, "literal")


@dataclass(frozen=True, kw_only=True)
class Unmeasured:
    """A sentence of a paper without a row, or one that shares the row of a different sentence.

    row   the row that also measures it; None if there is no such row
    part  the literal reading of that row that corresponds to it; None for all of them
    why   the reason why it has no row: a definition, proved here in three lines, not testable because ...
    """

    where: str
    quote: str
    row: str | None = None
    part: int | None = None
    why: str


def finding_of(readings: Sequence[Reading]) -> Finding:
    """Return the finding on a sentence. Raises ValueError if no reading is literal."""
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
    """Return the condition of *holds if*, which is the first weaker reading that holds; empty for other findings."""
    if finding_of(readings) != "holds if":
        return ""
    return next(reading.says for reading in readings if reading.role == "weaker" and reading.holds)
