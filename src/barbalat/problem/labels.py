"""Names and units of states, output and inputs for the axes of pictures; they never affect numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from barbalat import validate
from barbalat.settings import Settings
from barbalat.validate import InputError, freeze


@dataclass(frozen=True, kw_only=True)
class Labels(Settings):
    """Names and units on the axes of pictures; no number is changed by them.

    names        one for each state, or one for the output, such as "alpha"
    units        one for each state, or one for the output, such as "rad/s"
    input_units  one for each input, such as "deg"
    """

    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    input_units: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for field, given in (("names", self.names), ("units", self.units), ("input_units", self.input_units)):
            if not isinstance(given, (list, tuple)):
                raise InputError.of(f"labels.{field}", f"must be a list of strings, got {validate.show(given)}")
            freeze(self, **{field: tuple(validate.line(f"labels.{field}", one) for one in given)})

    def require(self, measured: int, inputs: int) -> None:
        """InputError if the counts don't equal those of the states, or the output, and of the inputs; empty labels always fit."""
        for field, given, wanted in (
            ("names", self.names, measured),
            ("units", self.units, measured),
            ("input_units", self.input_units, inputs),
        ):
            if given and len(given) != wanted:
                raise InputError.of(f"labels.{field}", f"must have {validate.counted(wanted, 'entry')}, got {len(given)}")

    def name(self, i: int) -> str:
        """Return the name of the i-th state or of the output; empty if none is given."""
        return self.names[i] if self.names else ""

    def of_states(self, n: int) -> tuple[str, ...]:
        """The names of n states, by default x_1, x_2, ..."""
        return self.names or tuple(f"x_{i + 1}" for i in range(n))

    def unit(self, i: int) -> str:
        """Return the unit as it is written after a name, such as "[rad/s]"; empty if none is given."""
        return bracketed(self.units[i : i + 1])

    @property
    def common_unit(self) -> str:
        """The unit of all states, if they have the same one."""
        return bracketed(self.units) if len(set(self.units)) == 1 else ""

    @property
    def every_unit(self) -> str:
        """The common unit, or all of them, "[rad, rad/s]"; empty if none is given."""
        return self.common_unit or (f"[{', '.join(unit or '1' for unit in self.units)}]" if any(self.units) else "")

    @property
    def every_input_unit(self) -> str:
        """The units of all inputs, as they are written after names."""
        return self.input_unit or (f"[{', '.join(unit or '1' for unit in self.input_units)}]" if any(self.input_units) else "")

    @property
    def input_unit(self) -> str:
        """The unit of all inputs, if they have the same one."""
        return bracketed(self.input_units) if len(set(self.input_units)) == 1 else ""


UNLABELLED = Labels()
"""The labels of a problem that has none."""


def bracketed(units: Sequence[str]) -> str:
    """The first non-empty unit, in brackets; empty if there is none."""
    return f"[{units[0]}]" if units and units[0] else ""
