"""Tracking against robustness: what each scheme's own knobs buy, with the Pareto front of each scheme in one plane."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from barbalat import validate
from barbalat.adaptation.laws import LeastSquares
from barbalat.certify.table import certify
from barbalat.controllers import L1Adaptive, Mrac, RobustMrac
from barbalat.engine import Progress
from barbalat.ensemble import simulate_ensemble
from barbalat.grid import Simulation
from barbalat.known_set import ParameterBox
from barbalat.linear import input_filter
from barbalat.problem import Problem
from barbalat.protocols import Controller
from barbalat.study.delay_margin import Lost, delay_margins
from barbalat.validate import Array, InputError


@dataclass(frozen=True, eq=False, kw_only=True)
class Knobs:
    """A scheme and the settings that are varied, all combinations of them; ``make`` builds the controller."""

    scheme: str
    values: dict[str, Array]
    make: Callable[..., Controller]

    def tunings(self) -> Iterator[dict[str, float]]:
        for combination in product(*self.values.values()):
            yield dict(zip(self.values, map(float, combination), strict=True))


@dataclass(frozen=True, eq=False, kw_only=True)
class Cloud:
    """One scheme's tunings with what they reach.

    tunings        K settings by name
    error          (K, P) RMS of |e| over the run without delay, relative to the RMS of |x_m|; NaN where the run diverged
    margin         (K, P) the largest added delay that the loop was seen to bear [s]
    The P plants are the case's own first, then those of the seeded sample of the known set.
    """

    scheme: str
    tunings: tuple[dict[str, float], ...]
    error: Array
    margin: Array

    def at(self, which: str) -> tuple[Array, Array]:
        """(error, margin), (K,) each: of the case's "plant", or of the "worst" plant, each on its own."""
        if which == "plant":
            return self.error[:, 0], self.margin[:, 0]
        with np.errstate(invalid="ignore"):
            return self.error.max(axis=1), self.margin.min(axis=1)  # a NaN among the errors stays one

    def front(self, which: str) -> Array:
        """Indices of the Pareto front, by growing margin: no other tuning has as much margin and less error."""
        return pareto_front(*self.at(which))


@dataclass(frozen=True, eq=False, kw_only=True)
class TradeOff:
    """The clouds of all schemes on one problem."""

    problem: Problem
    simulation: Simulation
    thetas: Array  # (P, n)
    clouds: tuple[Cloud, ...]
    excluded: tuple[str, ...]
    runs: int
    seconds: float


def pareto_front(error: Array, margin: Array) -> Array:
    """Indices of the tunings that no other one beats in both, by growing margin; a lost tuning is on no front."""
    usable = np.flatnonzero(np.isfinite(error) & (margin > 0))
    order = usable[np.lexsort((-margin[usable], error[usable]))]  # least error first, of equal ones the larger margin
    kept: list[int] = []
    for i in order:
        if not kept or margin[i] > margin[kept[-1]]:
            kept.append(int(i))
    return np.array(kept, dtype=int)


def default_knobs(problem: Problem, simulation: Simulation, *, density: int = 12) -> tuple[Knobs, ...]:
    """MRAC: Gamma; L1-AC: kappa x Gamma; robust MRAC: tau x covariance0, with ``density`` values for each second knob.

    Gamma goes up to the largest gain that this step resolves (``certify``'s gamma_max, an estimate), kappa and tau from five
    steps to the slowest time constant of the model.
    """
    highest = certify(problem, (Mrac(gamma=1.0),), simulation)["MRAC"].values.get("gamma_max")
    if not highest:
        raise InputError(f"simulation.dt = {simulation.dt:g} s resolves no adaptive gain for this command; make it smaller")
    slowest = 1 / float(np.abs(np.linalg.eigvals(problem.plant.A_m).real).min())
    times = np.geomspace(5 * simulation.dt, slowest, 3 * density)
    gains = highest * np.geomspace(1e-7, 1.0, density)
    return (
        Knobs(
            scheme="MRAC", values={"gamma": highest * np.geomspace(1e-8, 1.0, 8 * density)}, make=lambda gamma: Mrac(gamma=gamma)
        ),
        Knobs(
            scheme="L1-AC",
            values={"kappa": times, "gamma": gains},
            make=lambda kappa, gamma: L1Adaptive(gamma=gamma, filter=input_filter(kappa)),
        ),
        Knobs(
            scheme="Robust MRAC",
            values={"tau": times, "covariance0": np.geomspace(1e-2, 1e4, density)},
            make=lambda tau, covariance0: RobustMrac(tau=tau, law=LeastSquares(covariance0=covariance0)),
        ),
    )


def trade_off(
    problem: Problem,
    simulation: Simulation,
    *,
    knobs: tuple[Knobs, ...] | None = None,
    plants: int = 4,
    seed: int = 0,
    longest: float = 2.0,
    lost: Lost | None = None,
    estimate: Callable[[float], None] | None = None,
    progress: Progress | None = None,
) -> TradeOff:
    """Run every tuning of every scheme on the case's plant and on ``plants`` - 1 others, drawn from the known set.

    longest   largest delay tried [s]
    estimate  called once with the expected seconds, measured on a part of the work
    Raises InputError for a problem without a box as known set.
    """
    if not isinstance(problem.uncertainty, ParameterBox):
        raise InputError("the trade-off needs the known set: give uncertainty.lower and uncertainty.upper")
    validate.whole("plants", plants, least=1)
    chosen = default_knobs(problem, simulation) if knobs is None else knobs
    box, random = problem.uncertainty, np.random.default_rng(seed)
    thetas = np.vstack([problem.plant.theta, random.uniform(box.lower, box.upper, (plants - 1, box.size))])
    family = [replace(problem, plant=replace(problem.plant, theta=theta)) for theta in thetas]
    members = {k.scheme: [(p, k.make(**tuning)) for tuning in k.tunings() for p in family] for k in chosen}
    total = sum(map(len, members.values()))
    if estimate is not None:
        estimate(_expected_seconds(members, simulation))
    started, done, runs, clouds = time.perf_counter(), 0, 0, []
    scale = _model_rms(problem, simulation)
    for k in chosen:
        share, before = len(members[k.scheme]) / total, done / total

        def advanced(fraction: float, share: float = share, before: float = before) -> None:
            if progress is not None:
                progress(before + share * fraction)

        found = delay_margins(members[k.scheme], simulation, longest=longest, lost=lost, progress=advanced)
        error = np.linalg.norm(found.undelayed.rms_e, axis=1) / scale
        shape = (-1, plants)
        clouds.append(
            Cloud(scheme=k.scheme, tunings=tuple(k.tunings()), error=error.reshape(shape), margin=found.bears.reshape(shape))
        )
        runs += found.runs
        done += len(members[k.scheme])
    return TradeOff(
        problem=problem,
        simulation=simulation,
        thetas=thetas,
        clouds=tuple(clouds),
        excluded=(
            f"gains above gamma_max at h = {simulation.dt:g} s, which this step does not resolve, are left out",
            f"time constants below five steps, {5 * simulation.dt:g} s, are left out",
        ),
        runs=runs,
        seconds=time.perf_counter() - started,
    )


ROUNDS = 12
"""Simulations that a member takes on average: the scan ends where it is lost, then some halvings."""


def _expected_seconds(members: dict[str, list[tuple[Problem, Controller]]], simulation: Simulation) -> float:
    """From the time of a small ensemble of each scheme over a twentieth of the run, with a delay as later."""
    seconds = 0.0
    steps = max(simulation.steps // 20, 4)
    part = Simulation(t_end=steps * simulation.dt, dt=simulation.dt, solver=simulation.solver)
    for group in members.values():
        chosen = group[:: max(len(group) // 64, 1)]
        pairs = [(_with_delay(p, (4 + i) * simulation.dt), c) for i, (p, c) in enumerate(chosen)]
        simulate_ensemble(pairs, replace(part, t_end=4 * simulation.dt))  # compiles
        started = time.perf_counter()
        simulate_ensemble(pairs, part)
        each = (time.perf_counter() - started) / len(pairs) * simulation.steps / steps
        seconds += each * len(group) * ROUNDS
    return seconds


def _with_delay(problem: Problem, delay: float) -> Problem:
    (path,) = problem.plant.paths
    return replace(problem, plant=replace(problem.plant, input=replace(path, delay=path.delay + delay)))


def _model_rms(problem: Problem, simulation: Simulation) -> float:
    """RMS of |x_m|_2 over the run."""
    from barbalat.simulation import simulate

    run = simulate(problem, [Mrac(gamma=1e-12, name="model")], replace(simulation, record_points=4000))["model"]
    return float(np.sqrt(np.mean(np.sum(run.x_m**2, axis=1))))
