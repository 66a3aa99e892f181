"""A row with the part that a test examines. Its other parts are placeholders."""

from __future__ import annotations

from typing import Any

from barbalat.papers.claim import Claim
from barbalat.papers.finding import Reading, Sentence, Source

SOMEBODY = Source("somebody_2000", "Somebody (2000)", "others")


def a_claim(name: str, *holds: bool, statement: str = "it is so", quote: str = "It is so.", **given: Any) -> Claim:
    """A claim named ``name`` with a literal reading for each entry of ``holds``, ``weaker`` readings, and any other field of a
    claim."""
    literal = tuple(f"part {i}" for i in range(len(holds)))
    sentence = Sentence(row=name, source=SOMEBODY, where="Section V", quote=quote, statement=statement, literal=literal)
    weaker: tuple[Reading, ...] = given.pop("weaker", ())
    readings = (*(sentence.reads(one, "2", part) for part, one in enumerate(holds)), *weaker)
    texts = {"shows": "It is 7.", "measured": "1", "how": "as said", "would_change": "another number"}
    return Claim(sentence=sentence, readings=readings, **texts | given)
