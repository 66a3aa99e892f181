"""Nanoseconds for one step of one member: a single trajectory, and an ensemble on one core."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from benchmarks import c, gcc, kernel
from benchmarks.kernel import WITH_FIGURES
from benchmarks.loops import Case
from benchmarks.peers import c_by_hand, numpy_loop
from benchmarks.race import CHECK_STEPS, Contestant, Time, check, fastest, race
from benchmarks.table import Row

SLOW_STEPS = CHECK_STEPS
"""Steps in a timed call of a peer that needs microseconds for each step. They also avoid a second compilation by JAX."""

MEMBERS = 1024
"""Sizes of the ensembles that have targets."""

Families = dict[str, list[Contestant]]
"""Peers by kind. Only the fastest of each kind is reported."""


class Extent(NamedTuple):
    """The extent of a run: ``quick`` for a first impression, ``peers`` with optional packages."""

    quick: bool
    peers: bool


def trajectory(case: Case, folder: Path, extent: Extent) -> tuple[str, list[Row], list[str]]:
    """Compare one member with C, NumPy and, on request, Numba, JAX and diffrax."""
    steps, repeats = (20_000, 5) if extent.quick else (50_000, 15)
    peers, notes = _compiled(case, steps, folder, extent)
    peers |= {"NumPy": numpy_loop.contestants(case, SLOW_STEPS)} | _installed(case, steps, extent)
    targets = {"C": 1.2, "JAX": 40.0, "NumPy": 500.0}
    return f"{case.name}: one trajectory", _rows(case, steps, peers, repeats, targets), notes


def ensemble(case: Case, folder: Path, extent: Extent) -> tuple[str, list[Row], list[str]]:
    """Compare many members on one core with vectorised C, Numba's ``prange`` and the ``vmap`` of JAX and diffrax, which may use
    all cores.
    """
    steps, repeats = 4_000, (5 if extent.quick else 15)
    peers, notes = _compiled(case, steps, folder, extent)
    peers |= _installed(case, steps, extent)
    notes += [
        "JAX, diffrax and Numba's prange may use every core and go by the clock: others at work on this computer slow only them."
    ] * extent.peers
    targets = {"C": 1.1 if case.name.startswith("L1") else 1.0, "JAX": 25.0} if case.members == MEMBERS else {}
    title = f"{case.name}: ensemble of {case.members} members on one core"
    return title, _rows(case, steps, peers, repeats, targets), notes


def _compiled(case: Case, steps: int, folder: Path, extent: Extent) -> tuple[Families, list[str]]:
    if reason := gcc.missing():
        return {}, [f"skipped: {reason}"]
    peers = {f.name: c.contestants(case, steps, folder, f, quick=extent.quick) for f in c.families(case, quick=extent.quick)}
    return peers | {"C by hand": c_by_hand.contestants(case, steps, folder)}, []


def _installed(case: Case, steps: int, extent: Extent) -> Families:
    """The installed peers. There are none without ``peers``. In a quick run they have only Section V's L1 loop, as each compiles
    for seconds."""
    if not extent.peers or (extent.quick and not case.name.startswith("L1")):
        return {}
    from benchmarks.peers import diffrax_solve, jax_scan, numba_loop

    return {
        "Numba": numba_loop.contestants(case, steps),
        "JAX": jax_scan.contestants(case, SLOW_STEPS, quick=extent.quick),
        "diffrax": diffrax_solve.contestants(case, SLOW_STEPS, quick=extent.quick),
    }


def _rows(case: Case, steps: int, peers: Families, repeats: int, targets: dict[str, float]) -> list[Row]:
    """Check all, race the two fastest of every family, and return one row for each family."""
    ours, full = (kernel.contestant(case, steps, figures=figures) for figures in (False, True))
    peers = {name: family for name, family in peers.items() if family}
    check([full, *(contestant for family in peers.values() for contestant in family)], ours.run(CHECK_STEPS))
    chosen = {name: fastest(family, case.members, 2) if len(family) > 2 else family for name, family in peers.items()}
    times = race([ours, full, *(contestant for family in chosen.values() for contestant in family)], case.members, repeats)
    rows = []
    for name, family in chosen.items():
        mine = times[full.name if name.endswith(WITH_FIGURES) else ours.name]
        best = min((times[contestant.name] for contestant in family), key=lambda time: time.best)
        rows.append(_row(name, mine, best, targets.get(name)))
    return [*rows, _row("the kernel with figures", times[full.name], times[ours.name], None)]


def _row(what: str, mine: Time, other: Time, target: float | None) -> Row:
    return Row(what, f"{mine.name}: {mine}", f"{other.name}: {other}", other.best / mine.best, at_least=target)
