"""How sampled controllers tolerate lost measurements: the compiled C of each scheme runs through faults.

``python -m benchmarks.campaign`` writes docs/guides/campaign.txt. The cases are those whose cost is listed in the guide to flight
computers.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

from barbalat.export.campaign import Campaign, export_campaign
from barbalat.solvers.simulation import Simulation
from benchmarks.flight_cases import CASES, T

PAGE = Path(__file__).parents[1] / "docs" / "guides" / "campaign.txt"
SIMULATION = Simulation(t_end=30.0, dt=T / 10)
HEADINGS = (
    "controller",
    "largest error",
    "1 % lost",
    "10 % lost",
    "50 % lost",
    "bursts of 10",
    "longest outage",
    "outages in a row",
)


def row(name: str, found: Campaign) -> str:
    """A row of the page's table: the factors of the worst component, and the longest tolerated outage, alone and in a row."""
    *factors, regular = [_factor(found.factor(one)) for one in found.rows]
    outage = f"{found.longest * found.sample_time:.2g} s{' or more' if found.longest == found.most else ''}"
    cells = [name, f"{max(found.nominal):.2g}", *factors, outage, regular]
    return f"| {' | '.join(cells)} |"


def _factor(value: float) -> str:
    return "diverges" if math.isinf(value) else f"{value:.2f}" if value < 100 else f"{value:.2g}"


def main() -> int:
    """Write the page."""
    lines = [f"| {' | '.join(HEADINGS)} |", f"|{' --- |' * len(HEADINGS)}"]
    for name, problem, controller in CASES:
        lines.append(row(name, export_campaign(problem.nominal, controller, SIMULATION)))
        print(lines[-1], flush=True)
    PAGE.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
