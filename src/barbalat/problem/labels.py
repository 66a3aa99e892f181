"""Names and units of states, output and inputs, for the axes of pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from barbalat import validate
from barbalat.settings import Settings
from barbalat.validate import InputError, freeze


@dataclass(frozen=True, kw_only=True)
class Labels(Settings):
    """Names and units on the axes of pictures. They never affect numbers.

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
        """Raise InputError if the counts differ from those of the states, or of the output, and of the inputs. Empty labels
        always fit."""
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
        """Return the names of n states, by default x_1, x_2, ..."""
        return self.names or tuple(f"x_{i + 1}" for i in range(n))

    def unit(self, i: int) -> str:
        """Return the unit in brackets, such as "[rad/s]", to be written after a name; empty if none is given."""
        return bracketed(self.units[i : i + 1])

    @property
    def common_unit(self) -> str:
        """The common unit of all states; empty if they have different ones."""
        return bracketed(self.units) if len(set(self.units)) == 1 else ""

    @property
    def every_unit(self) -> str:
        """The common unit, or the list of units, "[rad, rad/s]"; empty if none is given."""
        return self.common_unit or (f"[{', '.join(unit or '1' for unit in self.units)}]" if any(self.units) else "")

    @property
    def every_input_unit(self) -> str:
        """The units of all inputs, in brackets, to be written after names."""
        return self.input_unit or (f"[{', '.join(unit or '1' for unit in self.input_units)}]" if any(self.input_units) else "")

    @property
    def input_unit(self) -> str:
        """The common unit of all inputs; empty if they have different ones."""
        return bracketed(self.input_units) if len(set(self.input_units)) == 1 else ""


UNLABELLED = Labels()
"""The labels of a problem that has none."""


def bracketed(units: Sequence[str]) -> str:
    """Return the first non-empty unit in brackets, or an empty text if there is none."""
    return f"[{units[0]}]" if units and units[0] else ""
