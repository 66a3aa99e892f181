"""Forecasts the duration of a trade-off, from small ensembles before it starts and from its pace while it runs."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.modelling_error import DelayError
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.kernel.grid import CHUNK_STEPS
from barbalat.run.kernel.step import Rhythm
from barbalat.solvers.simulation import Simulation
from barbalat.study.ideal_benchmark import SIZES_TRIED, with_error
from barbalat.study.verdicts import Member

RUNS_EACH = 16.5
"""Number of simulations per member, measured on Section V. Many members are lost early in the scan, and bisections follow."""
ENSEMBLES_EACH = 20
"""Number of ensembles per scheme: the scan, the bisections, and the first one without a delay."""
TIMED_MEMBERS = 64, 16
"""Number of timed members."""


@dataclass(frozen=True)
class Cost:
    """The cost of an ensemble in seconds, ``call`` + members (``member`` + steps ``step``)."""

    call: float
    member: float
    step: float

    @classmethod
    def measured(cls, members: Sequence[Member], simulation: Simulation) -> Cost:
        """Fit the cost to three ensembles: many members over two run lengths, and few members over the shorter one. With a
        tolerance, only few members are timed."""
        many, few = (list(members[:: max(len(members) // size, 1)][:size]) for size in TIMED_MEMBERS)
        if simulation.tolerance is not None:
            return cls(0.0, _timed(few, simulation, simulation.steps) / len(few), 0.0)
        least = _fewest_steps(members[0], simulation)
        long = min(simulation.steps, max(2 * CHUNK_STEPS, 2 * least))
        short = max(long // 2, least)
        if long <= short or len(few) == len(many):  # too little work to distinguish the parts
            whole = _timed(many, simulation, short)
            return cls(0.0, 0.0, whole / (len(many) * short))
        _timed(many, simulation, least)  # the first call includes compilation
        at_short, at_long, of_few = (
            _timed(*run) for run in ((many, simulation, short), (many, simulation, long), (few, simulation, short))
        )
        step = max((at_long - at_short) / (len(many) * (long - short)), 0.0)
        member = max((at_short - of_few) / (len(many) - len(few)) - short * step, 0.0)
        return cls(max(at_short - len(many) * (member + short * step), 0.0), member, step)

    def seconds(self, members: int, problems: int, steps: int) -> float:
        """Return the time of all rounds of a scheme with this number of members and plants, including the loops with known
        theta."""
        runs = RUNS_EACH * members + 2 * SIZES_TRIED * problems
        return ENSEMBLES_EACH * self.call + runs * (self.member + steps * self.step)


def _fewest_steps(member: Member, simulation: Simulation) -> int:
    """Return the number of steps in which events at fixed instants, such as samples of a controller or new noise, occur once."""
    problem, controller = member
    rhythm = Rhythm.of(ClosedLoop.of(problem, controller), problem.noise, simulation)
    return max(3, rhythm.sample_every, rhythm.noise_hold)


def _timed(members: Sequence[Member], simulation: Simulation, steps: int) -> float:
    """Return the seconds of a run with delays from two steps up to those of the later rounds."""
    delays = np.geomspace(4, max(steps, 5), len(members)) * simulation.resolution
    added, error = zip(members, delays, strict=True), DelayError()
    delayed = [(with_error(problem, error, float(d)), controller) for (problem, controller), d in added]
    part = simulation if steps == simulation.steps else replace(simulation, t_end=steps * simulation.dt)
    taken = []
    for _ in range(2):  # twice, because the machine may be busy for a moment
        started = time.perf_counter()
        simulate_ensemble(delayed, part, estimated=True)
        taken.append(time.perf_counter() - started)
    return min(taken)


OWN_PACE_FRACTION = 0.1
"""Fraction of the work after which the remaining time follows only from the pace of the work. The timing of small ensembles may
not be representative, or most runs may be lost early."""


@dataclass
class Forecast:
    """The total seconds of several parts of one task, which are refined while the parts run."""

    expected: dict[str, float]  # seconds of each part, estimated before it started
    finished: dict[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, schemes: Mapping[str, Sequence[Member]], plants: int, simulation: Simulation) -> Forecast:
        """Return the forecast for each scheme's members on this number of plants."""
        costs = {name: Cost.measured(members, simulation) for name, members in schemes.items()}
        return cls({name: cost.seconds(len(schemes[name]), plants, simulation.steps) for name, cost in costs.items()})

    @contextmanager
    def timed(self, part: str) -> Iterator[None]:
        """Count the work done inside this block as work of the part."""
        begun = time.perf_counter()
        yield
        self.finished[part] = time.perf_counter() - begun

    def total(self, part: str, fraction: float, seconds: float) -> float:
        """Return the total seconds, if a fraction of ``part`` is finished after the given seconds.

        The estimates determine the fraction of the work for each part; the actual pace gradually replaces the estimate of the
        total.
        """
        whole = sum(self.expected.values())
        done = sum(self.expected[name] for name in self.finished) + fraction * self.expected[part]
        spent = sum(self.finished.values()) + seconds
        trust = min(1.0, done / (OWN_PACE_FRACTION * whole))
        pace = spent / done if done > 0 else 1.0
        return spent + (whole - done) * (trust * pace + 1 - trust)
