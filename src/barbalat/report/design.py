"""A design as rows of tables, for its page and for the terminal."""

from __future__ import annotations

from barbalat.comparison.design.design import LOST, Candidate, Design
from barbalat.pictures.symbols import number_text
from barbalat.problem.labels import Labels, bracketed
from barbalat.report.omissions import grouped_omissions
from barbalat.report.terminal.layout import Screen

COLUMNS = (
    "scheme",
    "requirement",
    "asked",
    "on the worst plant",
    "fraction of the limit used",
    "validation plants that violate it",
)


def rows(found: Design) -> list[list[str]]:
    """Return a row for each scheme and requirement: the required value, the achieved value, the used fraction of the limit, and
    the number of validation plants that violate the requirement."""
    return [row for one in found.candidates for row in [*(_row(found, one, name) for name in one.factor), *_failed(found, one)]]


def _failed(found: Design, one: Candidate) -> list[list[str]]:
    share = found.failed(one)
    return (
        []
        if share is None
        else [[one.name, "no failed run under other commands", "", "", "", f"{share.count} of {share.judged} runs"]]
    )


def _row(found: Design, one: Candidate, name: str) -> list[str]:
    share = one.held_out.get(name)
    unseen = "not tried" if share is None else f"{share.count} of {share.judged}"
    if name == LOST:
        return [one.name, "never lost or in a limit cycle under the command of the case", "", "", "", unseen]
    asked, labels = number_text(float(getattr(found.specification, name))), found.case.problem.labels or Labels()
    units = {
        "settling": ("s",), "delay": ("s",), "u_max": labels.input_units, "error": labels.units[found.test.component :],
    }.get(name, ())  # fmt: skip
    return [
        one.name,
        f"{name} {bracketed(units)}".rstrip(),
        asked,
        f"{one.worst[name]:.4g}",
        f"{one.factor[name]:.2g}",
        unseen,
    ]


def sentences(found: Design) -> list[tuple[str, str, bool]]:
    """Return for each candidate its name, a sentence on the requirements that it meets or violates and on failed validation runs,
    and whether it meets all requirements and failed in no run."""
    return [_sentence(found, one) for one in found.candidates]


def _sentence(found: Design, one: Candidate) -> tuple[str, str, bool]:
    failure = found.failure(one)
    only, also = ("", "") if failure is None else (" only under the command of the case", f"; {failure}")
    said = f"meets it{only}: it {one.sentence}" if one.meets else one.sentence
    return one.name, f"{said}{also}", one.meets and failure is None


def show(screen: Screen, found: Design) -> None:
    """Print the recommendation, its reasons and a sentence on every candidate."""
    screen.title(found.headline)
    for said in found.reasons:
        screen.line(f"{said[0].upper()}{said[1:]}.", start="- ")
    screen.title("All candidates")
    for name, said, _ in sentences(found):
        screen.line(f"{name} {said}.", start="- ")
    for said in grouped_omissions(found.contest.left_out):
        screen.line(f"{said[0].upper()}{said[1:]}.", start="- ")
