"""Nanoseconds for one step of one member: a single trajectory, and an ensemble on one core."""

from __future__ import annotations

from pathlib import Path

from benchmarks import c, jax_scan, kernel, numba_loop, numpy_loop
from benchmarks.kernel import WITH_FIGURES
from benchmarks.loops import Case
from benchmarks.race import CHECK_STEPS, Contestant, Time, check, fastest, race
from benchmarks.table import Row

SLOW_STEPS = CHECK_STEPS
"""Steps of a timed call of a peer that needs microseconds a step; also spares JAX a second compilation."""


def trajectory(case: Case, folder: Path, *, quick: bool) -> tuple[str, list[Row], list[str]]:
    """One member: against C, Numba, JAX, NumPy."""
    steps, repeats = (20_000, 7) if quick else (50_000, 15)
    ours, full = (kernel.contestant(case, steps, figures=figures) for figures in (False, True))
    peers = _c_peers(case, steps, folder, quick=quick) | _jax_peers(case)
    notes = [f"skipped: {reason}" for m in (c, numba_loop, jax_scan) if (reason := m.missing())]
    if not numba_loop.missing() and not quick:
        peers["Numba"] = numba_loop.contestants(case, steps)
    peers["NumPy"] = [numpy_loop.contestant(case, SLOW_STEPS)]
    times = _verified_race(ours, full, peers, case, repeats)
    return f"{case.name}: one trajectory", _rows(times, ours, full, peers, {"C": 1.2, "JAX": 40.0, "NumPy": 500.0}), notes


def ensemble(case: Case, folder: Path, *, quick: bool) -> tuple[str, list[Row], list[str]]:
    """Many members on one core: against vectorised C, and JAX's vmap, which may use all cores."""
    steps, repeats = (5_000, 5) if quick else (20_000, 9)
    ours, full = (kernel.contestant(case, steps, figures=figures) for figures in (False, True))
    peers = _c_peers(case, steps, folder, quick=quick) | _jax_peers(case)
    notes = [f"skipped: {reason}" for m in (c, jax_scan) if (reason := m.missing())]
    notes.append("JAX may use every core; all others run on one.")
    times = _verified_race(ours, full, peers, case, repeats)
    title = f"{case.name}: ensemble of {case.members} members on one core"
    return title, _rows(times, ours, full, peers, {"C": 1.0, "JAX": 25.0}), notes


def _jax_peers(case: Case) -> dict[str, list[Contestant]]:
    if jax_scan.missing():
        return {}
    both = (jax_scan.equations(case, SLOW_STEPS), jax_scan.operation_list(case, SLOW_STEPS))
    return {contestant.name: [contestant] for contestant in both}


def _c_peers(case: Case, steps: int, folder: Path, *, quick: bool) -> dict[str, list[Contestant]]:
    if c.missing():
        return {}
    families = {"C": (c.PLAIN, False), "C, -fno-trapping-math": (c.NO_TRAPS, False), f"C{WITH_FIGURES}": (c.FIGURES, True)}
    return {
        name: c.contestants(case, steps, folder, flags, figures=figures, quick=quick)
        for name, (flags, figures) in families.items()
    }


def _verified_race(
    ours: Contestant, full: Contestant, peers: dict[str, list[Contestant]], case: Case, repeats: int
) -> dict[str, Time]:
    """Check all, let the two fastest of every family race; ``peers`` keeps only those."""
    check([full, *(contestant for family in peers.values() for contestant in family)], ours.run(CHECK_STEPS))
    for name, family in peers.items():
        peers[name] = fastest(family, case.members, 2) if len(family) > 2 else family
    return race([ours, full, *(contestant for family in peers.values() for contestant in family)], case.members, repeats)


def _rows(
    times: dict[str, Time], ours: Contestant, full: Contestant, peers: dict[str, list[Contestant]], targets: dict[str, float]
) -> list[Row]:
    rows = []
    for name, family in peers.items():
        mine = times[full.name if name.endswith(WITH_FIGURES) else ours.name]
        best = min((times[contestant.name] for contestant in family), key=lambda time: time.best)
        rows.append(Row(name, f"{mine.name}: {mine}", f"{best.name}: {best}", best.best / mine.best, at_least=targets.get(name)))
    alone, with_figures = times[ours.name], times[full.name]
    ratio = alone.best / with_figures.best
    return [*rows, Row("the kernel with figures", f"{with_figures.name}: {with_figures}", f"{alone.name}: {alone}", ratio)]
