"""Omitted schemes, grouped by the reason of their omission."""

from __future__ import annotations

import re
from collections.abc import Iterable

from barbalat.controllers import SCHEMES

_OMITTED = re.compile(r"(?P<who>.+?) is omitted: (?P<why>.+)")


def grouped_omissions(sentences: Iterable[str]) -> list[str]:
    """Return the sentences, with one sentence for all schemes omitted for the same reason."""
    groups: dict[str, list[tuple[str, str]]] = {}
    for sentence in sentences:
        found = _OMITTED.fullmatch(sentence)
        why = sentence if found is None else _reason(found["why"])
        groups.setdefault(why, []).append((sentence, "" if found is None else found["who"]))
    return [group[0][0] if len(group) == 1 else _together([who for _, who in group], why) for why, group in groups.items()]


def _together(names: list[str], why: str) -> str:
    """Return the sentence on several schemes. A name may contain a comma."""
    between = "; " if any("," in name for name in names) else ", "
    each = f"they declare{why.removeprefix('declares')}" if why.startswith("declares ") else f"each {why}"
    return f"{between.join(names)} are omitted: {each}"


def _reason(why: str) -> str:
    """Return the reason without the name of the scheme and without the list of schemes that support such a plant."""
    first, _, rest = why.partition(" ")
    if first in SCHEMES:
        return rest.partition("; ")[0]
    return rest if first == "it" else why
