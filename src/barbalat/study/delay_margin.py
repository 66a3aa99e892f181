"""The delay that a loop bears, found by simulation: a scan, then bisection, for many loops at once.

Beside the exact margin of a linear loop this one holds for the adaptive loop in motion, but for the run that was made only:
it is measured, not guaranteed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.certify.certificate import Certificate
from barbalat.engine import Progress
from barbalat.ensemble import simulate_ensemble
from barbalat.grid import Simulation
from barbalat.metrics import Metrics
from barbalat.problem import TrackingProblem
from barbalat.protocols import Controller
from barbalat.validate import Array, InputError

Member = tuple[TrackingProblem, Controller]


@dataclass(frozen=True, kw_only=True)
class Lost:
    """When a run counts as lost: it diverged, or its error grew by more than ``share`` of the model's own motion.

    share  of the largest |x_m| of the run, for the largest |e| of the tail beyond that without the delay. 1 by default: the
           error that the delay adds has become as large as the motion that is asked for. Below that a delay costs
           performance; an unstable loop passes it, also one that projection or saturation keeps bounded
    """

    share: float = 1.0

    def __post_init__(self) -> None:
        validate.freeze(self, share=validate.positive("share", self.share))

    def judge(self, metrics: Metrics, undelayed: Array, amplitude: Array) -> Array:
        """(M,) truth values; ``undelayed`` and ``amplitude`` (M,): the tail's error without the delay, the model's size."""
        tail = metrics.tail_max_abs_e.max(axis=1)
        return np.asarray(~(tail <= undelayed + self.share * amplitude))  # NaN, a diverged run, is lost


@dataclass(frozen=True, eq=False, kw_only=True)
class DelayMargins:
    """For M members, each (M,).

    bears      the largest delay that was tried below the first losing one [s]; 0 where the loop is lost without any
    loses      the smallest delay that was tried and lost [s]; infinite where none was
    undelayed  figures without an added delay
    runs       simulations made
    """

    bears: Array
    loses: Array
    undelayed: Metrics
    runs: int


def delay_margins(
    members: Sequence[Member],
    simulation: Simulation,
    *,
    longest: float = 2.0,
    scan: int = 12,
    resolution: float = 0.02,
    lost: Lost | None = None,
    numbers: Sequence[int] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> DelayMargins:
    """The delay, beside the one that the plant has, at which each loop is lost: see ``Lost``.

    longest     largest delay tried [s]
    scan        delays tried first, geometrically from two solver steps (the shortest that can be simulated) to ``longest``:
                a loop that is lost, saved and lost again as the delay grows is caught where the scan resolves it
    resolution  relative distance of ``bears`` and ``loses`` at which bisection ends
    numbers     as for ``simulate_ensemble``: a member has one noise in all its runs, whoever runs beside it

    Members have one structure, as for ``simulate_ensemble``; they advance together. Raises InputError.
    """
    judge = lost or Lost()
    shortest = 2 * simulation.dt
    if not longest > shortest:
        raise InputError(f"longest must exceed two solver steps, {shortest:g} s, got {longest:g} s")
    validate.whole("scan", scan, least=2)
    resolution = validate.positive("resolution", resolution)
    delays = np.geomspace(shortest, longest, scan)
    halvings = max(0, int(np.ceil(np.log2(np.log(delays[1] / delays[0]) / np.log1p(resolution)))))
    rounds, done = scan + halvings, 0

    def advanced(fraction: float) -> None:
        if progress is not None:
            progress(min(1.0, (done + fraction) / rounds))

    def run(chosen: Array, added: Array) -> Metrics:
        changed = [(_delayed(members[i][0], float(delay)), members[i][1]) for i, delay in zip(chosen, added, strict=True)]
        return simulate_ensemble(changed, simulation, numbers=streams[chosen], threads=threads, progress=advanced).metrics

    streams = np.arange(len(members)) if numbers is None else np.asarray(numbers)
    undelayed = simulate_ensemble(members, simulation, numbers=streams, threads=threads).metrics
    amplitude = _amplitudes(members, simulation)
    base = undelayed.tail_max_abs_e.max(axis=1)
    bears, loses = np.zeros(len(members)), np.full(len(members), np.inf)
    open_members = np.flatnonzero(np.isfinite(base))
    loses[~np.isfinite(base)] = 0.0
    runs = len(members)
    for done, delay in enumerate(delays):  # noqa: B007  # from short to long; a member that is lost is not run again
        if len(open_members) == 0:
            break
        gone = judge.judge(run(open_members, np.full(len(open_members), delay)), base[open_members], amplitude[open_members])
        runs += len(open_members)
        loses[open_members[gone]] = delay
        open_members = open_members[~gone]
        bears[open_members] = delay
    between = np.flatnonzero((bears > 0) & np.isfinite(loses))
    for done in range(scan, rounds):  # noqa: B007  # read by ``advanced``
        if len(between) == 0:
            break
        middle = np.sqrt(bears[between] * loses[between])
        gone = judge.judge(run(between, middle), base[between], amplitude[between])
        runs += len(between)
        loses[between[gone]] = middle[gone]
        bears[between[~gone]] = middle[~gone]
    advanced(1.0)
    return DelayMargins(bears=bears, loses=loses, undelayed=undelayed, runs=runs)


def with_simulated_margins(
    certificates: dict[str, Certificate],
    problem: TrackingProblem,
    controllers: Sequence[Controller],
    simulation: Simulation,
    progress: Progress | None = None,
) -> dict[str, Certificate]:
    """The certificates with ``delay_margin_simulated`` [s], beside the linear loops' exact margins."""
    result = dict(certificates)
    for i, controller in enumerate(controllers):

        def advanced(fraction: float, i: int = i) -> None:
            if progress is not None:
                progress((i + fraction) / len(controllers))

        found = delay_margins([(problem, controller)], simulation, progress=advanced)
        old = result[controller.name]
        longest = "" if np.isfinite(found.loses[0]) else "; the longest delay that was tried"
        result[controller.name] = replace(
            old,
            values={**old.values, "delay_margin_simulated": float(found.bears[0])},
            assumptions=(
                *old.assumptions,
                "delay_margin_simulated was measured on the case's own run, a loop being lost when its error has grown by the "
                f"largest |x_m| or it diverged: no guarantee{longest}",
            ),
        )
    return result


def _delayed(problem: Any, delay: float) -> TrackingProblem:
    """The problem with a delay added to each input."""
    paths = tuple(replace(path, delay=path.delay + delay) for path in problem.plant.paths)
    changed: TrackingProblem = replace(problem, plant=replace(problem.plant, input=paths[0] if len(paths) == 1 else paths))
    return changed


def _amplitudes(members: Sequence[Member], simulation: Simulation) -> Array:
    """(M,) the largest |x_m| or |y_m| of the run; members with one model and one command share it."""
    known: dict[Any, float] = {}
    result = []
    for problem, _ in members:
        model = problem.model
        key = (*(np.asarray(part).tobytes() for part in _numbers(model)), problem.commands)
        if key not in known:
            known[key] = _amplitude(problem, simulation)
        result.append(known[key])
    return np.array(result)


def _numbers(model: Any) -> list[Any]:
    return (
        [model.A_m, model.b, model.k_0, model.x0] if hasattr(model, "A_m") else [model.system.A, model.system.B, model.system.C]
    )


def _amplitude(problem: TrackingProblem, simulation: Simulation) -> float:
    """Of the model alone, by its exact response on the solver's grid: a linear system driven by the recorded command."""
    from scipy.signal import StateSpace as Continuous
    from scipy.signal import lsim

    model: Any = problem.model
    steps = min(simulation.steps, 20_000)
    t = np.linspace(0.0, simulation.t_end, steps + 1)
    r = np.stack([signal(t) for signal in problem.commands], axis=1)
    if hasattr(model, "A_m"):
        B = model.b.reshape(len(model.b), -1) @ np.atleast_2d(model.k_0)
        A, C = model.A_m, np.eye(len(model.b))
    else:
        A, B, C = model.system.A, model.system.B[:, None], model.system.C[None]
    _, y, _ = lsim(  # type: ignore[call-overload]
        Continuous(A, B, C, np.zeros((len(C), B.shape[1]))), r, t, X0=model.x0
    )
    return float(np.abs(y).max())
