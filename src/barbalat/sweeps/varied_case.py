"""A case file with other numbers at some of its places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.cases.build import Case
from barbalat.cases.load import CaseText
from barbalat.sweeps.paths import FieldPath
from barbalat.sweeps.spread import Distribution, Uniform, parse_distribution
from barbalat.sweeps.varied import Varied
from barbalat.validate import Array, InputError

KNOWN_SET = "known-set"
"""In place of a distribution: uniform over the case's known set."""


@dataclass(frozen=True, eq=False)
class VariedCase(Varied):
    """What stands at ``paths`` is given for each member; everything else is the file's."""

    text: CaseText
    paths: tuple[FieldPath, ...]

    @property
    def source(self) -> str:
        return self.text.text

    def at(self, values: Sequence[float] | Array) -> Case:
        """The case with these numbers, checked as any other; InputError where it can't be used."""
        tables = self.text.data()
        for path, value in zip(self.paths, values, strict=True):
            path.put(tables, float(value))
        return self.text.case(tables)


def sampled(text: CaseText | None, given: Sequence[tuple[str, str | Distribution]]) -> dict[FieldPath, Distribution]:
    """Pairs of path and distribution; a vector over a case file's known set becomes a distribution for each entry."""
    found: dict[FieldPath, Distribution] = {}
    for place, distribution in given:
        path = FieldPath.parse(place)
        if not isinstance(distribution, str):
            drawn = {path: distribution}
        elif distribution == KNOWN_SET and text is not None:
            drawn = _over_known_set(text, path)
        else:
            drawn = {path: _named(path, distribution)}
        if twice := [str(one) for one in drawn if one in found]:
            raise InputError(f"{twice[0]} is sampled twice")
        found |= drawn
    return found


def _named(path: FieldPath, distribution: str) -> Distribution:
    try:
        return parse_distribution(distribution)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _over_known_set(text: CaseText, path: FieldPath) -> dict[FieldPath, Distribution]:
    """Independent in each entry, as is uniform in a box."""
    entries, uncertainty = path.of(text.data()), text.data().get("uncertainty", {})
    lower, upper = uncertainty.get("lower"), uncertainty.get("upper")
    if not isinstance(entries, list) or not isinstance(lower, list) or not isinstance(upper, list):
        raise InputError(
            f"{path} = known-set needs a vector there and a box of the same size, uncertainty.lower and uncertainty.upper; "
            f"got {validate.show(entries)}"
        )
    if np.shape(entries) != np.shape(lower) or np.shape(lower) != np.shape(upper):
        raise InputError(f"{path} = known-set needs as many entries as uncertainty.lower has, {len(lower)}, got {len(entries)}")
    return {path.entry(i): Uniform(float(low), float(high)) for i, (low, high) in enumerate(zip(lower, upper, strict=True))}
