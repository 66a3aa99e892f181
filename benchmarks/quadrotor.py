"""Fly the schemes through the failures of the quadrotor and write docs/laboratory/quadrotor-flights.txt.

Nothing is timed here. The numbers come from the simulator and are the same on every machine of the same kind. This takes some
minutes. ``python -m benchmarks.quadrotor FLY.json`` uses the numbers that ``barbalat fly quadrotor --delays --json`` has printed.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parents[1] / "docs" / "laboratory" / "quadrotor-flights.txt"


def table(document: dict[str, Any]) -> str:
    """The table in Markdown, with a row for each scheme, the activity of its rotors without a failure, and the delay that it
    tolerates."""
    names = list(document["failures"])
    heads = ["scheme", *(f"`{name}`" for name in names), "rotors, `none` [N/s]", "tolerated delay [ms]"]
    rows = [heads, ["---"] * len(heads)]
    for scheme, flights in document["controllers"].items():
        rotors, delay = flights["none"]["rotor_travel"], 1e3 * document["delay_borne"][scheme]
        rows.append([scheme, *(cell(flights[name]) for name in names), f"{rotors:.2f}", f"{delay:.1f}"])
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def cell(figures: dict[str, Any]) -> str:
    """The error, or the instant at which the quadrotor was lost."""
    return f"{figures['rms_e']:.3f}" if figures["lost_at"] is None else f"lost, {figures['lost_at']:.1f} s"


def flown() -> dict[str, Any]:
    """The document of all flights."""
    from barbalat.flights import fly
    from barbalat.report.flights import as_document

    return as_document(fly("quadrotor", delays=True))


if __name__ == "__main__":
    PAGE.write_text(table(json.loads(Path(sys.argv[1]).read_text()) if sys.argv[1:] else flown()))
