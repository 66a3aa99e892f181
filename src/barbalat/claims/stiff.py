"""The claim that a solver for stiff problems does not help: implicit methods at a fixed step, and codes with automatic steps."""

from __future__ import annotations

import time
from functools import cache
from typing import NamedTuple

import numpy as np

from barbalat.claims import section_v
from barbalat.claims.claim import Claim, Listing, verdict
from barbalat.claims.stiff_methods import NEWTON_STEPS, WINDOW, Path, SciPyMethod, cvodes, implicit, scipy_path
from barbalat.claims.variants import numbers
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.known_set import ParameterBox
from barbalat.protocols import Controller
from barbalat.run.simulate import simulate
from barbalat.solvers.simulation import Simulation

T_END = 20.0
AUTOMATIC_END = 3.0
"""[s]: past the time at which RK4 has left the solution at the paper's step, and before any estimate reaches its bound."""
TOLERANCE = 1e-7
"""Relative, of the codes with automatic steps; at 1e-6 they damp the ringing by a quarter and more (docs/claims.md)."""
EVALUATIONS: dict[SciPyMethod, int] = {"LSODA": 1_000_000, "BDF": 20_000, "Radau": 20_000}
"""Budgets: LSODA is compiled; SciPy's other two are Python, 20 to 40 us for each evaluation, and would need half a minute each."""
CONVERGED_STEPS = (1e-6, 5e-7)
"""Steps [s] at which h |lambda| is 0.07 and less: two that agree show what the equations do."""
AGREEMENT_FACTOR = 1.25
"""Factor between the ringing of a run and the converged one; what is called wrong here is off by 2 to 2000."""
CASES = ("L1, no projection", "L1")
TAIL = (0.75 * T_END, T_END)
LATE_WINDOW = (AUTOMATIC_END - 0.1, AUTOMATIC_END)


class Row(NamedTuple):
    """One solver: its paths without projection and with it, and the time over which its ringing is taken."""

    name: str
    setting: str
    free: Path
    boxed: Path
    span: tuple[float, float]


def _controllers() -> list[Controller]:
    return [section_v.l1(name, 1e4, projection=name == "L1") for name in CASES]


@cache
def _rk4(h: float) -> tuple[Path, Path]:
    """L1-AC with RK4, without projection and with it."""
    started = time.process_time()
    windows = round(T_END / WINDOW)
    runs = simulate(section_v.problem(), _controllers(), Simulation(t_end=T_END, dt=h, record_points=windows))
    seconds = (time.process_time() - started) / 2
    paths = []
    for run in (runs[name] for name in CASES):
        least, greatest = np.full((2, windows, 2), np.nan)
        kept = len(run.envelope.theta_hat_min)
        least[:kept], greatest[:kept] = run.envelope.theta_hat_min, run.envelope.theta_hat_max
        reached = T_END if run.diverged_at is None else run.diverged_at
        paths.append(
            Path(
                least=least,
                greatest=greatest,
                final=run.theta_hat[-1],
                reached=reached,
                lost=run.diverged_at is not None,
                evaluations=round(4 * reached / h),
                seconds=seconds,
            )
        )
    return paths[0], paths[1]


def converged() -> tuple[Path, Path]:
    """What the equations do, without projection and with it, over T_END s."""
    return _rk4(CONVERGED_STEPS[1])


def own_oscillation() -> Claim:
    """What is left of the oscillation when the step goes to zero."""
    steps = [_rk4(h) for h in (section_v.FINE, *CONVERGED_STEPS)]
    free, boxed = ([path.ringing(*TAIL) for path in paths] for paths in zip(*steps, strict=True))
    early = [path.ringing(*LATE_WINDOW) for path in (steps[0][1], steps[2][1])]
    agree = bool(np.allclose(free[1], free[2], rtol=0.1))
    return Claim(
        "own-oscillation", "Section V, Figure 4", "With the step reduced to 1e-5 s the oscillation is gone, because it was numerical",
        verdict(holds=bool((boxed[2] < 0.01).all()), conditional=agree and bool((free[2] > 3 * free[0]).all())),
        f"the estimates' ringing at h = 1e-5, 1e-6, 5e-7 s: with projection {', '.join(map(numbers, boxed))}: gone, once they have touched "
        f"their bounds (at {AUTOMATIC_END:g} s, before that, {numbers(early[0])} at h = 1e-5 s, {numbers(early[1])} at 5e-7 s). "
        f"Without projection {', '.join(map(numbers, free))}: there the equations themselves ring, and at h = 1e-5 s "
        "RK4's own damping hides it",
        f"L1-AC, kappa = 0.02 s, Gamma = 1e4, RK4, {T_END:g} s; ringing: half the largest swing within {WINDOW:g} s, over every step of the last quarter",
    )  # fmt: skip


def stiff_solvers() -> Claim:
    """Section V at the step where RK4 fails: without projection, and with it as in Figure 3."""
    right = converged()
    explicit = [Row("RK4", f"h = {h:g} s", *_rk4(h), TAIL) for h in (section_v.COARSE, section_v.FINE)]
    fixed, automatic = _fixed_rows(), _automatic_rows()
    avoided = [row for row in fixed if _agrees(row.free, right[0], TAIL) and _agrees(row.boxed, right[1], TAIL)]
    of_figure_3 = [row for row in fixed if _agrees(row.boxed, right[1], TAIL)]
    highest = np.nanmax(np.abs([(p.least, p.greatest) for p in right])[:, :, : round(AUTOMATIC_END / WINDOW)])
    return Claim(
        "stiff-solvers", "Section V", "Even with a solver for stiff problems the phenomenon cannot be avoided",
        verdict(holds=not avoided, conditional=bool(of_figure_3)),
        "ringing of the estimates over that of the converged solution, without / with projection: "
        + "; ".join(f"{row.name}, {row.setting}: {_cell(row, 0, right)} / {_cell(row, 1, right)}" for row in (*explicit, *fixed))
        + f". Automatic steps, up to {AUTOMATIC_END:g} s: "
        + "; ".join(f"{row.name} {_cell(row, 0, right)}, {row.free.evaluations} evaluations, {row.free.seconds:.1f} s" for row in automatic),
        f"right: within a factor {AGREEMENT_FACTOR:g} of RK4 at h = {CONVERGED_STEPS[1]:g} s, which rings by {numbers(right[0].ringing(*TAIL))} without and "
        f"{numbers(right[1].ringing(*TAIL))} with projection; last quarter of {T_END:g} s. Implicit steps: {NEWTON_STEPS} Newton steps of the exact Jacobian, "
        f"the estimate limited at the step's end. Automatic steps: relative tolerance {TOLERANCE:g}, exact Jacobian, last 0.1 s; up to there no estimate is "
        f"beyond {highest:.1f} and the projection at rest; the phenomenon begins at {explicit[0].free.reached:.1f} s. Longer runs: docs/claims.md",
        listings=(_listing([*explicit, *fixed, *automatic], right),),
    )  # fmt: skip


def _fixed_rows() -> list[Row]:
    given = section_v.problem()
    loop = ClosedLoop.of(given, _controllers()[0])
    assert isinstance(given.uncertainty, ParameterBox)
    kinds = (
        ("implicit midpoint", 0.5, section_v.COARSE),
        ("implicit Euler", 1.0, section_v.COARSE),
        ("implicit midpoint", 0.5, section_v.FINE),
    )
    return [
        Row(name, f"h = {h:g} s", *implicit(loop, given, h, T_END, weight, given.uncertainty), TAIL) for name, weight, h in kinds
    ]


def _automatic_rows() -> list[Row]:
    """With projection, which is at rest as long as these run."""
    given = section_v.problem()
    loop = ClosedLoop.of(given, _controllers()[1])
    paths = {"CVODES (BDF)": cvodes(loop, given, tolerance=TOLERANCE, t_end=AUTOMATIC_END)}
    for method, budget in EVALUATIONS.items():
        paths[f"{method} (SciPy)"] = scipy_path(loop, given, method, tolerance=TOLERANCE, t_end=AUTOMATIC_END, evaluations=budget)
    return [Row(name, f"tolerance {TOLERANCE:g}", path, path, LATE_WINDOW) for name, path in paths.items()]


def ratio(path: Path, right: Path, span: tuple[float, float]) -> float:
    """Its ringing over the converged one's: of the estimate for which it is farther from one."""
    ratios = path.ringing(*span) / right.ringing(*span)
    return float(ratios[np.abs(np.log(np.maximum(ratios, 1e-9))).argmax()])


def _agrees(path: Path, right: Path, span: tuple[float, float]) -> bool:
    return (
        not path.lost
        and path.reached >= span[1] * (1 - 1e-9)
        and 1 / AGREEMENT_FACTOR < ratio(path, right, span) < AGREEMENT_FACTOR
    )


def _cell(row: Row, which: int, right: tuple[Path, Path]) -> str:
    """The ratio and what it means, or why there is none."""
    path = (row.free, row.boxed)[which]
    if path.lost:
        return f"lost at {path.reached:.2g} s"
    if path.reached < row.span[1] * (1 - 1e-9):
        return f"not decided (spent at {path.reached:.2g} s)"
    value = ratio(path, right[which], row.span)
    word = "right" if _agrees(path, right[which], row.span) else "too much" if value > 1 else "damped"
    return f"{value:.3g} ({word})"


def _listing(rows: list[Row], right: tuple[Path, Path]) -> Listing:
    return Listing(
        "Solvers on L1-AC of Section V, Gamma = 1e4: ringing of the estimates over the converged solution's, evaluations of the right-hand side (Newton "
        "steps of the implicit ones) per simulated second without projection, and the seconds of one core of this computer",
        ("solver", "step or tolerance", "until [s]", "without projection", "with projection", "evaluations per s", "core s"),
        tuple(
            (
                row.name, row.setting, f"{row.free.reached:.3g}", _cell(row, 0, right), _cell(row, 1, right),
                f"{row.free.evaluations / row.free.reached:.2g}", f"{row.free.seconds:.2g}",
            )
            for row in rows
        ),
    )  # fmt: skip
