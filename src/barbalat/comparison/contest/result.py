"""The result of a contest: the entrants that meet the rule, their slack, their failures in validation, and significant
differences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from barbalat.certificates.linear_loops.margin_values import finite
from barbalat.comparison.contest.rule import Rule
from barbalat.comparison.contest.tuned import Qualified
from barbalat.comparison.contest.validation import Draws, Remeasured, Validation
from barbalat.pictures.plotted import Plotted
from barbalat.problem.state_feedback import Problem
from barbalat.solvers.simulation import Simulation
from barbalat.study.reference_motion import ReferenceMotion
from barbalat.sweeps.statistics import CONFIDENCE_LEVEL, Median, Share
from barbalat.validate import Array, Named

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class Paired:
    """The comparison of two entrants on the same plants, commands and noise.

    Plants and noise are independent draws. The commands are a fixed set, each with the same number of plants. The number of runs
    below a value is then a sum of independent draws of unequal probability, which a binomial interval covers at least as often
    (Hoeffding, 1956).

    ratio     median of the ratio of the first entrant's error to the second's; infinite or 0 if half of the runs failed for only
              one of them
    interval  the interval of the ratio
    better, worse  fractions of the runs in which the first entrant has the smaller or the larger error; a failed run counts as
                   the larger error
    both_failed    number of runs in which both failed; they count for neither
    """

    first: str
    second: str
    ratio: float
    interval: tuple[float, float]
    better: Share
    worse: Share
    both_failed: int

    @property
    def settled(self) -> bool:
        """Whether the interval is on one side of 1."""
        return self.interval[1] < 1 or self.interval[0] > 1

    def as_json(self) -> dict[str, object]:
        low, high = self.interval
        return {
            "first": self.first,
            "second": self.second,
            "ratio": finite(self.ratio),
            "interval": [finite(low), finite(high)],
            "confidence": CONFIDENCE_LEVEL,
            "better": self.better.as_json(),
            "worse": self.worse.as_json(),
            "both_failed": self.both_failed,
        }


def paired(first: tuple[str, Validation], second: tuple[str, Validation]) -> Paired:
    """Compare two entrants, each with its name, that were measured on the same draws."""
    (one, a), (other, b) = first, second
    ratios = log_ratios(a.error, b.error)
    middle = Median.of(ratios)
    low, high = middle.interval
    return Paired(
        first=one,
        second=other,
        ratio=float(np.exp(middle.value)),
        interval=(float(np.exp(low)), float(np.exp(high))),
        better=Share.of(ratios < 0),
        worse=Share.of(ratios > 0),
        both_failed=int((np.isinf(a.error) & np.isinf(b.error)).sum()),
    )


def log_ratios(a: Array, b: Array) -> Array:
    """Return log(a/b) (M,), which is 0 if both failed and infinite if only one did."""
    both = np.isinf(a) & np.isinf(b)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(both, 0.0, np.log(a) - np.log(b))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Contest(Plotted):
    """All entrants: those that meet the rule first, ordered by validation failures, then by the median of their error.

    problem   the problem, including its noise
    thetas    (P, p) theta of the tuning plants
    held_out  validation results by name, for the entrants that meet the rule
    pairs     pairs of these entrants, each with every entrant ranked below it
    again     by name, some validation runs repeated with a finer step
    left_out  sentences on schemes that do not take part and on what was not tried
    """

    problem: Problem
    simulation: Simulation
    rule: Rule
    thetas: Array
    entrants: tuple[Qualified, ...]
    draws: Draws
    held_out: Mapping[str, Validation]
    pairs: tuple[Paired, ...]
    left_out: tuple[str, ...]
    notes: tuple[str, ...]
    again: Mapping[str, Remeasured]
    seconds: float

    def __repr__(self) -> str:
        found = (f"{one.name} {self._said(one)}" for one in self.entrants)
        return f"<Contest on {self.problem.name!r}: {'; '.join(found)}>"

    def _said(self, one: Qualified) -> str:
        if one.name not in self.held_out:
            return "does not satisfy the rule"
        held = self.held_out[one.name]
        return f"{held.quantiles['median']:.3g} ({int(held.lost.sum())} of {len(held.lost)} failed)"

    @cached_property
    def motion(self) -> float:
        """The RMS of |x_m| under the command of the problem."""
        return ReferenceMotion.of(self.problem, self.simulation).rms

    def plot(self, *, shown: bool = True) -> Figure:
        """Draw the error of every validation run of every entrant as a Matplotlib figure. Raises InputError if no entrant meets
        the rule.

        shown  whether to display the figure at once, if pyplot is in use
        """
        from barbalat.comparison.contest.picture import draw

        return draw(self, shown=shown)

    def __getitem__(self, name: str) -> Qualified:
        """Return the entrant with this name. Raises KeyError for an unknown name."""
        return Named.of("entrant", {one.name: one for one in self.entrants})[name]

    def as_json(self) -> dict[str, Any]:
        """Return the document of ``contest --json``."""
        noise = self.problem.noise
        return {
            "case": self.problem.name,
            "simulation": self.simulation.as_json(),
            "rule": self.rule.as_json(),
            "noise": None if noise is None else {"std": np.atleast_1d(noise.std).tolist(), "sample_time": noise.sample_time},
            "thetas": self.thetas.tolist(),
            "held_out": {"members": len(self.draws), "commands": np.unique(self.draws.commands, axis=0).tolist()},
            "entrants": {one.name: self._entrant(one) for one in self.entrants},
            "pairs": [one.as_json() for one in self.pairs],
            "left_out": list(self.left_out),
            "notes": list(self.notes),
            "seconds": self.seconds,
        }

    def _entrant(self, one: Qualified) -> dict[str, Any]:
        held = self.held_out.get(one.name)
        return {
            **one.as_json(self.rule),
            "held_out": None if held is None else held.as_json(),
            "held_out_at_finer_step": None if one.name not in self.again else dict(vars(self.again[one.name])),
        }
