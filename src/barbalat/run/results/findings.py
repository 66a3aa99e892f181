"""Findings: what of a run deserves a second look, as sentences that several runs can share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.judge.cycles import FEWEST_REVERSALS, TURNS_EXPLAIN
from barbalat.judge.held import Held
from barbalat.judge.verdict import Class, Verdict, percent
from barbalat.problem.command_gain import command_warning
from barbalat.problem.departures import departures
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import InterpolatedSignal

KINDS = (
    "solver", "half step", "record of a signal", "truth", "known set", "ranges", "command", "damping", "shakes", "held", "still",
    "on bounds", "between bounds", "excitation", "true values", "order", "coarse record",
)  # fmt: skip
"""In the order in which they matter."""
OF_EACH_RUN = ("half step", "shakes", "held")
"""Kinds whose sentences have numbers of one run, and are told of each."""


@dataclass(frozen=True)
class Finding:
    """A sentence about a run; findings of one ``kind``, of KINDS, say the same of several runs, or estimates."""

    kind: str
    sentence: str


def of_problem(problem: TrackingProblem, t_end: float) -> list[Finding]:
    """What all runs of a problem up to ``t_end`` [s] have in common."""
    said = {
        "command": command_warning(problem),
        "truth": truth_apart(problem),
        "ranges": unmatched_ranges(problem),
        "known set": problem.outside_known_set,
        "record of a signal": held_after_its_end(problem, t_end),
    }
    return [Finding(kind, sentence) for kind, sentence in said.items() if sentence is not None]


SHAKES = 10
"""Times what commands and disturbances explain, that a control turns back in a run, from which on it is said to shake."""


def shaking(problem: TrackingProblem, verdict: Verdict | None, t_end: float, share: float) -> str | None:
    """A sentence where a control that is in no limit cycle turns back far more often than what drives it."""
    if verdict is None or verdict.figures is None or verdict.kind not in (Class.FOLLOWS, Class.OFF):
        return None
    if not verdict.settled or verdict.of_the_solver:
        return None
    turns, count = Held.of(problem.signals, 0.0, t_end).turns, max(verdict.figures.reversals)
    if count <= SHAKES * (FEWEST_REVERSALS + TURNS_EXPLAIN * turns):
        return None
    return (
        f"its control shakes: it turns back {count} times, {count / t_end:.3g} times a second, by {percent(share)} of its range "
        f"at least, where commands and disturbances turn {validate.counted(turns, 'time')}"
    )


def lost_when_held(verdict: Verdict | None) -> str | None:
    """A sentence where the continuation in which a limit cycle is looked for diverges."""
    if verdict is None or not verdict.lost_when_held:
        return None
    return (
        "its control swings, and it is lost when the run is continued without noise, with command and disturbances held where "
        "they are largest in the tail: a longer run may be lost too"
    )


def truth_apart(problem: TrackingProblem) -> str | None:
    """A sentence where what is simulated departs from what the controllers are designed for."""
    found = departures(problem) if isinstance(problem, Problem) else []
    return f"the truth departs from the design: {'; '.join(one.sentence for one in found)}" if found else None


def unmatched_ranges(problem: TrackingProblem) -> str | None:
    """A sentence where ranges of physical parameters leave what no estimate matches."""
    derived = problem.derived if isinstance(problem, Problem) else None
    return None if derived is None or derived.is_matched else derived.sentences[1]


def held_after_its_end(problem: TrackingProblem, t_end: float) -> str | None:
    """A sentence where a recorded command or disturbance ends before the run does, at ``t_end`` [s]."""
    for signal in problem.signals:
        if not isinstance(signal, InterpolatedSignal):
            continue
        times, values = (np.asarray(part, dtype=float) for part in signal.interpolation_points)
        if times[-1] < t_end:
            what = "the recorded command" if any(signal is one for one in problem.commands) else "a recorded disturbance"
            return f"{what} ends at t = {times[-1]:.6g} s and is held at its last value, {values[-1]:.4g}, until t = {t_end:g} s"
    return None


@dataclass(frozen=True)
class Told:
    """Findings of one kind, of all runs together.

    owners  the runs that have it; empty for what all runs have, where there are several
    text    the first one's sentence, and how many others there are
    """

    owners: tuple[str, ...]
    text: str


def together(found: Mapping[str, Iterable[Finding]]) -> list[Told]:
    """The findings of runs, by the runs' names, one for each kind, in the order of KINDS; those OF_EACH_RUN for each run."""
    kinds: dict[str, dict[str, list[str]]] = {}
    for name, findings in found.items():
        for finding in findings:
            kinds.setdefault(finding.kind, {}).setdefault(name, []).append(finding.sentence)
    told = []
    for kind, owners in sorted(kinds.items(), key=lambda item: KINDS.index(item[0])):
        if kind in OF_EACH_RUN:
            told += [Told((name,) if len(found) > 1 else (), sentence) for name, said in owners.items() for sentence in said]
            continue
        sentences = [sentence for said in owners.values() for sentence in said]
        others = len(dict.fromkeys(sentences)) - 1
        more = f" ({others} more of this kind)" if others else ""
        told.append(Told(tuple(owners) if len(owners) < len(found) else (), f"{sentences[0]}{more}"))
    return told
