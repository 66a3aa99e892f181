"""The samples that a run's controller missed: they were lost by faults or rejected by the shell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from barbalat.judge.verdict import percent
from barbalat.validate import counted

STEPS_OF_JITTER = 10
"""Solver steps to which a timer's jitter should be resolved: with fewer, the number of missed samples depends on the step."""


@dataclass(frozen=True)
class MissedSamples:
    """Counts of samples.

    samples   number of samples of the run
    missed    samples without a good measurement at the right time, at which the estimates are frozen and the model predicts
    in_a_row  the longest outage
    commands  samples without a good command, at which the last good command is held
    fallback  missed samples at which the shell's fallback acts because the outage is longer than ``longest_outage``
    named     name of the fallback
    jitter    the largest deviation of the timer's calls, in solver steps, to which the calls are rounded; 0 without jitter
    """

    samples: int
    missed: int
    in_a_row: int
    fallback: int
    named: str
    jitter: float = 0.0
    commands: int = 0

    @property
    def sentence(self) -> str | None:
        """The finding as a sentence; None if no sample was missed."""
        held = f"{percent(self.commands / self.samples)} of the"
        if not self.missed:
            told = f"{held} {counted(self.samples, 'command')} were lost or rejected by the shell; the last good one was held"
            return told if self.commands else None
        share = (
            f"{percent(self.missed / self.samples)} of the {counted(self.samples, 'sample')} were lost or rejected by the shell"
        )
        longest = f"{share}, at most {self.in_a_row} in a row"
        if self.fallback:
            longest += f"; at {percent(self.fallback / self.samples)} of the samples the fallback ({self.named}) acted"
        if self.commands:
            longest += f"; {held} commands were lost or rejected, too"
        if 0 < self.jitter < STEPS_OF_JITTER:
            longest += (
                f"; calls are rounded to solver steps, but the timer's jitter is only {self.jitter:.2g} steps: use a smaller dt"
            )
        return longest

    def as_json(self) -> dict[str, Any]:
        return {
            "samples": self.samples,
            "missed": self.missed,
            "longest_outage": self.in_a_row,
            "commands": self.commands,
            "fallback": self.fallback,
        }
