"""One instance of a unit of FMI, stepped by FMPy. It imports nothing from the package."""

from __future__ import annotations

from pathlib import Path


class Slave:
    """One instance of a unit, accessed by the names of its variables."""

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

    def freeze(self, on: bool) -> None:
        self.fmu.setBoolean([self.at["freeze"]], [on])

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
        """The state as bytes. The copy of the string is freed."""
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
        """The names of an array's entries, or of the scalar."""
        found = [name for name in self.at if name == prefix or name.startswith(f"{prefix}[")]
        return sorted(found, key=lambda name: self.at[name])

    def close(self) -> None:
        self.fmu.terminate()
        self.fmu.freeInstance()
