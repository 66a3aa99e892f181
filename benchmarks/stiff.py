"""The stiff solvers of the claim `stiff-solvers` at several tolerances, as far as they get: ``python -m benchmarks.stiff``.

Some five minutes: what does not fit into ``barbalat reproduce``. The table of docs/claims.md is this one's.
"""

from __future__ import annotations

import argparse
import os
from typing import get_args

from barbalat.claims import section_v, stiff
from barbalat.claims.stiff_methods import Path, SciPyMethod, cvodes, scipy_path
from barbalat.loop.closed_loop import ClosedLoop
from benchmarks.table import console

TOLERANCES = (1e-3, 1e-6)
LONG_END = 10.0
"""[s]: past the contact with the bounds, from 6.5 to 9.3 s."""
LONG_TOLERANCE = 1e-6


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.stiff", description=__doc__)
    parser.add_argument(
        "--evaluations", type=int, default=3_000_000, help="budget of each run, in evaluations of the right-hand side"
    )
    budget = parser.parse_args().evaluations
    console.print(f"{os.cpu_count()} cores; load average before the start: {os.getloadavg()[0]:.2f}; budget {budget} evaluations")
    console.print("solver | projection | relative tolerance | to [s] | ringing / converged | evaluations | core s")
    for tolerance in TOLERANCES:
        for name in ("CVODES", *get_args(SciPyMethod)):
            run(name, tolerance, projection=False, t_end=stiff.AUTOMATIC_END, budget=budget)
    for name in ("CVODES", *get_args(SciPyMethod)):
        run(name, LONG_TOLERANCE, projection=True, t_end=LONG_END, budget=budget)


def run(name: str, tolerance: float, *, projection: bool, t_end: float, budget: int) -> None:
    """One row; the ringing is taken over the last 0.1 s of the run."""
    given = section_v.problem()
    loop = ClosedLoop.of(given, section_v.l1("L1", 1e4, projection=projection))
    path: Path
    if name == "CVODES":
        path = cvodes(loop, given, tolerance=tolerance, t_end=t_end)
    else:
        path = scipy_path(loop, given, name, tolerance=tolerance, t_end=t_end, evaluations=budget)  # type: ignore[arg-type]
    right = stiff.converged()[projection]
    ratio = (
        f"{stiff.ratio(path, right, (t_end - 0.1, t_end)):.3g}"
        if path.reached == t_end
        else "lost"
        if path.lost
        else "not decided"
    )
    cells = (
        name,
        "yes" if projection else "no",
        f"{tolerance:g}",
        f"{path.reached:.3g}",
        ratio,
        path.evaluations,
        f"{path.seconds:.1f}",
    )
    console.print(" | ".join(map(str, cells)))


if __name__ == "__main__":
    main()
