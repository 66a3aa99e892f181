"""Findings: facts about a run that need attention, stated as sentences that may apply to several runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from barbalat import validate
from barbalat.judge.cycles import FEWEST_REVERSALS, TURNS_EXPLAIN
from barbalat.judge.held import Held
from barbalat.judge.verdict import Class, Verdict, percent
from barbalat.problem.command_gain import command_warning
from barbalat.problem.departures import apart_sentence, departures
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import InterpolatedSignal
from barbalat.validate import Array

KINDS = (
    "solver", "missed", "half step", "record of a signal", "truth", "known set", "ranges", "wide ranges", "command", "damping",
    "delayed", "shakes", "held", "still", "assumed", "on bounds", "between bounds", "excitation", "true values", "order",
    "coarse record",
)  # fmt: skip
"""Kinds of findings, in order of importance."""
OF_EACH_RUN = ("missed", "half step", "delayed", "shakes", "held", "assumed")
"""Kinds whose sentences contain numbers of one run; these are reported for each run."""


@dataclass(frozen=True)
class Finding:
    """A sentence about a run. Findings of one ``kind``, which is one of KINDS, make the same statement about several runs or
    estimates."""

    kind: str
    sentence: str


def of_problem(problem: TrackingProblem, t_end: float) -> list[Finding]:
    """The findings that all runs of a problem up to ``t_end`` [s] share."""
    said = {
        "command": command_warning(problem),
        "truth": truth_apart(problem),
        "ranges": unmatched_ranges(problem),
        "wide ranges": wide_ranges(problem),
        "known set": problem.outside_known_set,
        "record of a signal": held_after_its_end(problem, t_end),
    }
    return [Finding(kind, sentence) for kind, sentence in said.items() if sentence is not None]


SHAKES = 10
"""A control counts as shaking if it reverses at least this many times as often as commands and disturbances explain."""


def shaking(problem: TrackingProblem, verdict: Verdict | None, t_end: float, share: float) -> str | None:
    """Return a sentence if a control without a limit cycle reverses far more often than the driving signals explain."""
    if verdict is None or verdict.figures is None or verdict.kind not in (Class.FOLLOWS, Class.OFF):
        return None
    if not verdict.settled or verdict.of_the_solver:
        return None
    turns, count = Held.of(problem.signals, 0.0, t_end).turns, max(verdict.figures.reversals)
    if count <= SHAKES * (FEWEST_REVERSALS + TURNS_EXPLAIN * turns):
        return None
    return (
        f"its control chatters: it reverses {count} times, {count / t_end:.3g} times a second, by at least {percent(share)} "
        f"of its range, while commands and disturbances reverse {validate.counted(turns, 'time')}"
    )


def behind_the_delay(problem: TrackingProblem, verdict: Verdict | None, t: Array, x_m: Array, tail: float) -> str | None:
    """Return a sentence if a run is off by no more than ``OFF_BY_DELAY`` times what the delay at the plant's input alone would
    cause. To find this, x_m (K, n) at the instants t (K,) is compared with itself delayed by this time, from ``tail`` [s] on."""
    names = list(problem.followed_names)
    if problem.delay == 0 or verdict is None or verdict.kind is not Class.OFF or verdict.component not in names:
        return None
    own = x_m[:, names.index(verdict.component)]
    behind = float(np.abs(own - np.interp(t - problem.delay, t, own))[t >= tail].max())
    if verdict.error is None or not verdict.band < behind or verdict.error > OFF_BY_DELAY * behind:
        return None
    unit = f" {verdict.unit}" if verdict.unit else ""
    return (
        f"the delay of {problem.delay:g} s at the plant's input alone keeps {verdict.component} up to {behind:.3g}{unit} from "
        f"the model, which has no delay, and the band is {verdict.band:.3g}{unit}. A loop that followed the model perfectly, "
        f"but later by this delay, would also be off"
    )


OFF_BY_DELAY = 2.0
"""The finding is reported for errors up to this multiple of the error that a delay alone causes."""


def lost_when_held(verdict: Verdict | None) -> str | None:
    """Return a sentence if the run diverges in the continuation that is examined for a limit cycle."""
    if verdict is None or not verdict.lost_when_held:
        return None
    return (
        "its control oscillates, and the loop is lost if the run continues without noise, with command and disturbances "
        "held at their largest values in the tail: a longer run may also be lost"
    )


def truth_apart(problem: TrackingProblem) -> str | None:
    """Return a sentence if the simulated plant differs from the design plant."""
    found = departures(problem) if isinstance(problem, Problem) else []
    return apart_sentence(found) or None


def unmatched_ranges(problem: TrackingProblem) -> str | None:
    """Return a sentence if ranges of physical parameters leave a remainder that estimates cannot match."""
    derived = problem.derived if isinstance(problem, Problem) else None
    return None if derived is None or derived.is_matched else derived.sentences[1]


def wide_ranges(problem: TrackingProblem) -> str | None:
    """Return a sentence if bounds from ranges of physical parameters are much wider than the values found at points."""
    derived = problem.derived if isinstance(problem, Problem) else None
    return None if derived is None else derived.too_wide


def held_after_its_end(problem: TrackingProblem, t_end: float) -> str | None:
    """Return a sentence if a recorded command or disturbance ends before the run does, at ``t_end`` [s]."""
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
    """The findings of one kind, combined over all runs.

    owners  the runs to which the finding applies; empty if it applies to all of several runs
    text    the sentence of the first finding, and the number of others
    """

    owners: tuple[str, ...]
    text: str


def together(found: Mapping[str, Iterable[Finding]]) -> list[Told]:
    """Merge the findings of all runs, given by run name, into one per kind, in the order of KINDS; kinds in OF_EACH_RUN keep one
    per run."""
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
