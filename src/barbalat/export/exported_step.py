"""The exported C in flight, compiled by this machine's compiler and run in parallel with the list from which it was printed."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, replace

import numpy as np

from barbalat.export.compiler import loaded, require_compiler, shared_library
from barbalat.export.contents import VECTORS, Contents
from barbalat.export.source import header, source
from barbalat.export.texts import Printed, filled, indented
from barbalat.lowering.c99 import DOUBLE
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.kernel.sampled_controller import Agreement, SampledList, SampledStep
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

OK = 0
"""The status of an accepted sample, as in ``templates/controller.h``."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ExportedList:
    """The export of a controller as machine code of this computer, with the list that it must equal.

    library  the compiled C, as the content of a file
    rows     rows of the simulated state that the C keeps, in its order
    members  names of these rows in C
    """

    simulated: SampledList
    library: bytes
    rows: tuple[int, ...]
    members: tuple[str, ...]

    @property
    def name(self) -> str:
        return self.simulated.name

    @property
    def sample_time(self) -> float:
        """The time between two calls of the exported step [s]."""
        return self.simulated.sample_time

    def step(self) -> ExportedStep:
        """The compiled step, loaded and in its initial state."""
        return ExportedStep(self)


def exported_c(problem: TrackingProblem, controller: Controller) -> ExportedList:
    """A sampled controller as the compiled C that ``export_controller`` writes, for ``software_in_the_loop`` of ``fly``.

    Raises InputError as ``export_controller`` does, and if there is no compiler.
    """
    compiler = require_compiler()
    simulated = SampledList.of(problem, controller)
    T = simulated.sample_time
    contents = Contents.of(problem, controller, Simulation(t_end=VECTORS * T, dt=T), DOUBLE)
    # A fixed prefix is safe: the symbols are not visible outside the library.
    printed = Printed(contents, prefix="exported")
    texts = {"controller.h": header(printed), "controller.c": source(printed), "flown.c": _adapter(printed)}
    return ExportedList(
        simulated=simulated,
        library=shared_library(compiler, texts),
        rows=tuple(contents.layout.entries()),
        members=tuple(text.removeprefix("c->") for text in contents.layout.entries().values()),
    )


def _adapter(printed: Printed) -> str:
    entries = [text.replace("c->", "controller.") for text in printed.contents.layout.entries().values()]
    return filled(
        "flown.c",
        name=printed.name,
        macro=printed.macro,
        measured=printed.measured,
        store=indented(f"kept[{i}] = {text};" for i, text in enumerate(entries)),
    )


class ExportedStep:
    """The loaded C: each call is one sample of the C and of the list, and u comes from the C. Not thread-safe."""

    def __init__(self, contents: ExportedList) -> None:
        self.contents, simulated = contents, contents.simulated
        self._beside, self._rows = SampledStep(simulated), list(contents.rows)
        self._handed, self._u = np.zeros(simulated.signals - 1), np.zeros(len(simulated.u))
        self._kept = np.zeros(len(contents.rows))
        self._addresses = tuple(part.ctypes.data for part in (self._handed, self._u, self._kept))
        self._library = loaded(contents.library)
        self._act = self._library.barbalat_act
        self._act.argtypes, self._act.restype = [ctypes.c_void_p] * 3, ctypes.c_uint
        self._told, self._apart = Agreement(), 0.0
        self.reset()

    @property
    def name(self) -> str:
        return self.contents.name

    def reset(self) -> None:
        """Return to the state before the first sample, by the function of the export."""
        self._library.barbalat_begin()
        self._beside.reset()

    def __call__(self, y: Array, r: Array | float) -> Array:
        """u, (m,), from the C at the next sample, from the measurement and the command."""
        measured = self.contents.simulated.measured
        self._handed[:measured], self._handed[measured:] = y, r
        refused = self._act(*self._addresses) != OK
        told, expected = self._told, self._beside(y, r)
        difference = told.difference or self._difference(expected)
        self._told = Agreement(samples=told.samples + 1, refused=told.refused + refused, difference=difference)
        if difference:
            self._apart = max(self._apart, float(np.abs(self._u - expected).max()))
        return self._u.copy()

    def agreement(self) -> Agreement:
        """The agreement of the exported C with the list over the samples since the last call."""
        told, apart = self._told, self._apart
        self._told, self._apart = Agreement(), 0.0
        return replace(told, difference=f"{told.difference}, u by at most {apart:.1e}") if told.difference else told

    def _difference(self, expected: Array) -> str:
        """The differences in u and in the whole state, bit by bit."""
        state = self._beside.state[self._rows]
        if _same(self._u, expected) and _same(self._kept, state):
            return ""
        apart = [member for member, a, b in zip(self.contents.members, self._kept, state, strict=True) if not _same(a, b)]
        return f"{(apart or ['u'])[0]} differs from sample {self._told.samples + 1} of a flight on"


def _same(a: Array, b: Array) -> bool:
    return bool(a.tobytes() == b.tobytes())
