"""What is guaranteed of each scheme, as statements with the case's constants: the entries of Table 1, see docs/table-1.md."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple


class Cell(NamedTuple):
    """A statement; "proven" holds under the column's assumptions, an "estimate" is advice."""

    kind: Literal["proven", "not proven", "estimate"]
    text: str


NONLINEAR = "known for phi(x) = x; where phi grows faster, a normalised law may be too slow to keep x bounded"

Analysis = Callable[[Any, Any, dict[str, Any]], tuple[str, dict[str, Cell]]]
"""From the problem, the controller and its certificate's values to the scheme's name and its statements."""


def limits_text(values: dict[str, Any]) -> str:
    """The numerics' limits, as far as there are any."""
    parts = []
    if values.get("gamma_max") is not None:
        parts.append(f"the solver at its step bears Gamma up to about {values['gamma_max']:.3g}")
    if values.get("step_max") is not None:
        parts.append(f"this gain bears a step up to about {values['step_max']:.3g} s")
    return "; ".join(parts) or "no limit of the step is known"


def margins_cell(values: dict[str, Any]) -> Cell:
    """Delay margins, at the case's theta and over the known set."""
    parts = []
    if "margins_of" in values:
        delay, which = values.get("delay_margin"), values["margins_of"].removeprefix("the linear loop ")
        parts.append(f"delay margin {'unlimited' if delay is None else f'{delay:.4g} s'} ({which})")
    for entry in values.get("margins_over_known_set", ()):
        which = entry["of"].removeprefix("the linear loop ")
        if "unstable_at" in entry:
            parts.append(f"over the known set unstable somewhere ({which})")
        elif "delay_margin" in entry:
            parts.append(f"over the known set {entry['delay_margin']['value']:.4g} s at the least found ({which})")
    if values.get("delay_margin_adapting") is not None:
        parts.append(f"linearised with its law at the largest command {values['delay_margin_adapting']:.3g} s")
    return Cell("estimate", "; ".join(parts) or "not known")


@dataclass(frozen=True)
class Column:
    """One controller: its statements by the keys of PROPERTIES, and what they assume."""

    name: str
    scheme: str
    cells: dict[str, Cell]
    assumptions: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        cells = {key: cell._asdict() for key, cell in self.cells.items()}
        return {"name": self.name, "scheme": self.scheme, "assumptions": list(self.assumptions), **cells}
