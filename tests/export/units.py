"""Exported units of FMI, and the ensemble whose members they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from barbalat.export.parameters import Opened
from barbalat.run.engine.engine import Batch
from barbalat.run.kernel.grid import signal_table
from barbalat.run.kernel.portable import standard_normal
from export.made import units


def write_units(folder: Path, problem, controller, simulation, version: int, **settings) -> dict[str, Path]:
    """Write the three units and return them by kind."""
    made = units(problem, controller, simulation, version=version, closed_loop=True, **settings)
    found = dict(zip(("controller", "plant", "loop"), made, strict=True))
    for name, content in made.items():
        (folder / name).write_bytes(content)
    return {what: folder / name for what, name in found.items()}


class Ensemble:
    """The case and, for each parameter of its units, the case with a different value of that parameter, all in one kernel."""

    def __init__(self, problem, controller, simulation) -> None:
        self.problem, self.simulation = problem, simulation
        self.opened = Opened.of(problem, controller, simulation, tunable=True)
        self.batch = Batch.of(self.opened.cases, simulation)

    def value(self, member: int) -> dict[str, float]:
        """The parameter that this member changes. The first member changes none."""
        return {self.opened.parameters[member - 1].name: self.opened.tried[member - 1]} if member else {}

    def run(self, samples: int) -> np.ndarray:
        """The loop's state (K, size, M) one sample time after each sample."""
        every, simulation = self.batch.rhythm.sample_every, self.simulation
        states = []
        for k in range(samples):
            table = signal_table(self.problem.signals, simulation, k * every, every, in_pieces=self.batch.program.shape.in_pieces)
            for group in self.batch.groups:
                group.call(k * every, 1, every, group.state, table)
            states.append(np.concatenate([g.state[:, : g.columns.stop - g.columns.start] for g in self.batch.groups], axis=1))
        return np.array(states)

    def commands(self, k: int) -> np.ndarray:
        """The commands (q,) at sample k, at exactly the simulation's instant."""
        every, in_pieces = self.batch.rhythm.sample_every, self.batch.program.shape.in_pieces
        table = signal_table(self.problem.signals, self.simulation, k * every, 1, in_pieces=in_pieces)
        return table[0, : len(self.problem.commands)]

    def noise(self, samples: int, member: int) -> np.ndarray:
        """The noise (K, channels) of a member's sensor before multiplication by the standard deviation."""
        channels, every, hold = self.batch.loop.signals.noise, self.batch.rhythm.sample_every, self.batch.rhythm.noise_hold
        if not channels:
            return np.zeros((samples, 0))
        rows = [k * every // hold for k in range(samples)]
        return standard_normal(self.problem.noise.seed, member, 0, rows[-1] + 1, channels)[rows]
