"""All schemes through all failures of the quadrotor: ``python -m benchmarks.quadrotor`` writes docs/guides/quadrotor-flights.txt.

Nothing is timed here: the numbers are the simulator's, and the same on every machine of its kind. It takes some minutes.
"""

from __future__ import annotations

from pathlib import Path

from barbalat.flight.compared import Flown
from barbalat.flight.quadrotor.comparison import QuadrotorComparison
from barbalat.flight.registry import fly

PAGE = Path(__file__).parents[1] / "docs" / "guides" / "quadrotor-flights.txt"


def table(found: QuadrotorComparison) -> str:
    """In Markdown: a row for each scheme, with its rotors' activity where nothing fails and the delay that it bears."""
    assert found.delays is not None
    names = [failure.name for failure in found.failures]
    heads = ["scheme", *(f"`{name}`" for name in names), "rotors, `none` [N/s]", "delay borne [ms]"]
    rows = [heads, ["---"] * len(heads)]
    for several in found.flights:
        first = several[0]
        rotors = first.figures["rotor_travel"]
        assert rotors is not None
        rows.append([first.controller, *map(cell, several), f"{rotors:.2f}", f"{1e3 * found.delays[first.controller]:.1f}"])
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def cell(flight: Flown) -> str:
    """The error, or when it was lost."""
    return f"lost, {flight.duration:.1f} s" if flight.lost else f"{flight.rms_error:.3f}"


if __name__ == "__main__":
    comparison = fly("quadrotor", delays=True)
    assert isinstance(comparison, QuadrotorComparison)
    PAGE.write_text(table(comparison))
