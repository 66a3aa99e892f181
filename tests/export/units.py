"""Exported units of FMI, stepped by FMPy; the ensemble whose members they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from barbalat.export.parameters import Opened
from barbalat.export.write import units
from barbalat.run.batch import Batch
from barbalat.run.grid import signal_table
from barbalat.run.noise import standard_normal


def write_units(folder: Path, problem, controller, simulation, version: int, **settings) -> dict[str, Path]:
    """The three units by what they are."""
    made = units(problem, controller, simulation, version=version, closed_loop=True, **settings)
    found = dict(zip(("controller", "plant", "loop"), made, strict=True))
    for name, content in made.items():
        (folder / name).write_bytes(content)
    return {what: folder / name for what, name in found.items()}


class Slave:
    """One instance of a unit by names of its variables."""

    def __init__(self, path: Path, folder: Path, starts: dict[str, float] | None = None) -> None:
        import fmpy
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        self.described = fmpy.read_model_description(str(path))
        unzipped = folder / f"{path.stem}-{len(list(folder.iterdir()))}"
        fmpy.extract(str(path), str(unzipped))
        self.two = self.described.fmiVersion == "2.0"
        kind = FMU2Slave if self.two else FMU3Slave
        identifier = self.described.coSimulation.modelIdentifier
        self.fmu = kind(
            guid=self.described.guid if self.two else self.described.instantiationToken,
            unzipDirectory=str(unzipped),
            modelIdentifier=identifier,
            instanceName=identifier,
        )
        self.fmu.instantiate()
        self.at = {one.name: one.valueReference for one in self.described.modelVariables}
        self.size = self.described.defaultExperiment.stepSize and float(self.described.defaultExperiment.stepSize)
        if self.two:
            self.fmu.setupExperiment(startTime=0.0)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=0.0)
        self.set({name: value for name, value in (starts or {}).items() if name in self.at})
        self.fmu.exitInitializationMode()

    def set(self, values: dict[str, float]) -> None:
        if values:
            references = [self.at[name] for name in values]
            (self.fmu.setReal if self.two else self.fmu.setFloat64)(references, list(values.values()))

    def get(self, *names: str) -> list[float]:
        return (self.fmu.getReal if self.two else self.fmu.getFloat64)([self.at[name] for name in names])

    def set_all(self, prefix: str, values) -> None:
        self.set(dict(zip(self.names(prefix), map(float, values), strict=True)))

    def get_all(self, prefix: str) -> list[float]:
        names = self.names(prefix)
        return self.get(*names) if names else []

    def step(self, t: float, size: float) -> None:
        self.fmu.doStep(currentCommunicationPoint=t, communicationStepSize=size)

    def whole(self, name: str) -> int:
        return (self.fmu.getInteger if self.two else self.fmu.getInt32)([self.at[name]])[0]

    def saved(self) -> bytes:
        """The state as bytes; its copy is freed."""
        if self.two:
            state = self.fmu.getFMUstate()
            kept = bytes(self.fmu.serializeFMUstate(state))
            self.fmu.freeFMUstate(state)
        else:
            state = self.fmu.getFMUState()
            kept = bytes(self.fmu.serializeFMUState(state))
            self.fmu.freeFMUState(state)
        return kept

    def restore(self, kept: bytes) -> None:
        if self.two:
            state = self.fmu.deSerializeFMUstate(kept)
            self.fmu.setFMUstate(state)
            self.fmu.freeFMUstate(state)
        else:
            state = self.fmu.deserializeFMUState(kept)
            self.fmu.setFMUState(state)
            self.fmu.freeFMUState(state)

    def names(self, prefix: str) -> list[str]:
        """An array's entries, or the scalar."""
        found = [name for name in self.at if name == prefix or name.startswith(f"{prefix}[")]
        return sorted(found, key=lambda name: self.at[name])

    def close(self) -> None:
        self.fmu.terminate()
        self.fmu.freeInstance()


class Ensemble:
    """The case, and beside it, for each parameter of its units, the case with another value of that: one kernel for all."""

    def __init__(self, problem, controller, simulation) -> None:
        self.problem, self.simulation = problem, simulation
        self.opened = Opened.of(problem, controller, simulation, tunable=True)
        self.batch = Batch.of(self.opened.cases, simulation)

    def value(self, member: int) -> dict[str, float]:
        """The parameter that this member has another value of; the first has none."""
        return {self.opened.parameters[member - 1].name: self.opened.tried[member - 1]} if member else {}

    def run(self, samples: int) -> np.ndarray:
        """(K, size, M) the loop's state one sample time after each sample."""
        every, simulation = self.batch.rhythm.sample_every, self.simulation
        states = []
        for k in range(samples):
            table = signal_table(self.problem.signals, simulation, k * every, every, in_pieces=self.batch.program.shape.in_pieces)
            for group in self.batch.groups:
                group.call(k * every, 1, every, group.state, table)
            states.append(np.concatenate([g.state[:, : g.columns.stop - g.columns.start] for g in self.batch.groups], axis=1))
        return np.array(states)

    def commands(self, k: int) -> np.ndarray:
        """(q,) at sample k, at the very time that the simulation has for it."""
        every, in_pieces = self.batch.rhythm.sample_every, self.batch.program.shape.in_pieces
        table = signal_table(self.problem.signals, self.simulation, k * every, 1, in_pieces=in_pieces)
        return table[0, : len(self.problem.commands)]

    def noise(self, samples: int, member: int) -> np.ndarray:
        """(K, channels) what the sensor of a member adds, before its standard deviation."""
        channels, every, hold = self.batch.loop.noise, self.batch.rhythm.sample_every, self.batch.rhythm.noise_hold
        if not channels:
            return np.zeros((samples, 0))
        rows = [k * every // hold for k in range(samples)]
        return standard_normal(self.problem.noise.seed, member, 0, rows[-1] + 1, channels)[rows]
