"""Software in the loop: the exported C, compiled on this machine, in place of the list from which it was printed."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, replace

import numpy as np

from barbalat.budget import Progress
from barbalat.export.compiler import loaded, require_compiler, shared_library
from barbalat.export.contents import Contents
from barbalat.export.source import header, source
from barbalat.export.texts import Printed, filled, indented
from barbalat.judge.appended import Watched
from barbalat.loop.around import Kept
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import flatten
from barbalat.lowering.c99 import DOUBLE, FLOAT
from barbalat.lowering.llvm.ir import ExternalFunction
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.engine import Batch, run
from barbalat.run.engine.simulate import result_of
from barbalat.run.engine.stability_label import MOST_WINDOWS
from barbalat.run.kernel.members import Members
from barbalat.run.kernel.sampled_controller import initial_acting
from barbalat.run.results.result import Result
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


@dataclass(frozen=True, eq=False)
class InTheLoop:
    """A run whose control was computed by the compiled export.

    result   as returned by ``simulate``; the states at recorded instants are computed by the list
    refused  number of samples whose measurement, command or result the export rejected
    """

    result: Result
    refused: int

    def differs_from(self, origin: Result) -> str:
        """A phrase that names the first quantity whose bits differ from the simulated run; empty if all are equal."""
        a, b = self.result, origin
        count = min(len(a.states), len(b.states))
        apart = np.flatnonzero((_bits(a.states[:count]) != _bits(b.states[:count])).any(axis=1))
        if len(apart):
            return f"the states differ from t = {a.t[apart[0]]:g} s on"
        if len(a.states) != len(b.states):
            return "only one of the two diverges, or one diverges earlier"
        names = [name for name, value in a.figures.items() if repr(value) != repr(b.figures[name])]
        return f"the metrics differ: {', '.join(names)}" if names else ""


def simulate_export(
    problem: TrackingProblem,
    controller: Controller,
    simulation: Simulation,
    *,
    float32: bool = False,
    progress: Progress | None = None,
) -> InTheLoop:
    """Simulate with the exported C in the loop, compiled by this machine's compiler; with ``float32``, its numbers have 32 bits.

    In float64 all metrics equal those of ``simulate``, bit for bit. Raises InputError as ``export_controller`` does, and if there
    is no compiler.
    """
    simulation.require_steps("software in the loop")
    flown, refused = Exported.of(problem, controller, simulation, float32=float32).fly(problem, progress=progress)
    return InTheLoop(result_of(problem, controller, simulation, flown), int(refused.sum()))


@dataclass(eq=False)
class Exported:
    """An export that is compiled once for runs with the same shell and the same kinds of faults."""

    printed: Printed
    controller: Controller
    simulation: Simulation
    windows: int = MOST_WINDOWS
    library: ctypes.CDLL | None = None

    @classmethod
    def of(
        cls,
        problem: TrackingProblem,
        controller: Controller,
        simulation: Simulation,
        *,
        float32: bool = False,
        windows: int = MOST_WINDOWS,
    ) -> Exported:
        """Raises InputError as ``simulate_export`` does."""
        require_compiler()
        contents = Contents.of(problem, controller, simulation, FLOAT if float32 else DOUBLE)
        # A fixed prefix is safe: the symbols are not visible outside the library.
        return cls(Printed(contents, prefix="exported"), controller, simulation, windows)

    def fly(
        self, problem: TrackingProblem, *, watched: Watched | None = None, progress: Progress | None = None
    ) -> tuple[Batch, Array]:
        """The batch of a recorded run, with or without a judge, and for each call whether the export did not
        fully accept its sample."""
        members = Members.read([(problem, self.controller)], self.simulation, windows=self.windows, watched=watched)
        if self.library is None:
            self.library = _compiled(self.printed, members.loop)
        outside = _outside(self.printed, members, self.library)
        members = replace(members, program=replace(members.program, outside=outside))
        batch = Batch.part(members, slice(0, 1), record=True, lanes=1)
        refused = np.zeros(self.simulation.steps + 1, dtype=np.uint8)  # at most one call in each step
        ctypes.c_void_p.in_dll(self.library, "barbalat_refused").value = refused.ctypes.data
        called, room = (ctypes.c_uint64.in_dll(self.library, f"barbalat_{name}") for name in ("called", "room"))
        called.value, room.value = 0, len(refused)
        ctypes.c_int.in_dll(self.library, "barbalat_in_a_row").value = 0
        run([batch], problem.signals, self.simulation, progress=progress)
        room.value = 0  # the judge may continue the run later
        return batch, refused[: called.value]


def _outside(printed: Printed, members: Members, library: ctypes.CDLL) -> ExternalFunction:
    """The adapter, with the rows of the loop's whole state that it receives and that it stores."""
    loop = members.loop
    first = loop.size - len(flatten(initial_acting(loop)))  # the controller's state is the last part of the loop state
    held = loop.unpack(np.arange(loop.size)).held
    measured = held.measured if loop.around is None else held.around.offered
    command = held.r if loop.around is None or not loop.around.checks_commands else held.around.commanded
    given = [*measured.reshape(-1).tolist(), *command.reshape(-1).tolist()]
    kept = [first + row for row in printed.contents.layout.rows]
    if loop.around is not None:
        given += [*held.around.lost.tolist(), *held.around.timer[2:].tolist()]
        kept += [row for _, rows in _of_the_shell(held.around) for row in rows]
    address = ctypes.cast(library.barbalat_sample, ctypes.c_void_p).value
    assert address is not None
    return ExternalFunction(address, tuple(map(int, given)), tuple(map(int, kept)))


def _of_the_shell(kept: Kept) -> list[tuple[str, list[int]]]:
    """The data of the shell in C, by their names in C, with their positions in the simulation."""
    names = ("outage", "fade_left", "bump", "repeats", "age", "command_outage", "advanced", "fade", "paused")
    return [(name, getattr(kept, name).tolist()) for name in names if getattr(kept, name).size]


def _compiled(printed: Printed, loop: ClosedLoop) -> ctypes.CDLL:
    texts = {"controller.h": header(printed), "controller.c": source(printed), "adapter.c": _adapter(printed, loop)}
    return loaded(shared_library(require_compiler(), texts))


def _adapter(printed: Printed, loop: ClosedLoop) -> str:
    entries = [text.replace("c->", "c.") for text in printed.contents.layout.entries().values()]
    load = [f"{text} = ({printed.real})kept[{i}];" for i, text in enumerate(entries)] + ["c.refused = barbalat_in_a_row;"]
    store = [f"kept[{i}] = (double){text};" for i, text in enumerate(entries)] + ["barbalat_in_a_row = c.refused;"]
    spoil, sample_time, idle, told, around = [], f"{printed.macro}_SAMPLE_TIME", "0", 0, printed.contents.around
    if loop.around is not None:
        held = loop.unpack(np.arange(loop.size)).held
        at = "numbers[{0}_MEASURED + {0}_COMMANDS + {1}]".format
        told = 4 if loop.around.jitters else 2
        if loop.around.jitters:
            idle, sample_time = f"{at(printed.macro, 2)} != 1", f"({printed.real}){at(printed.macro, 3)}"
        spoil += [f"if ({at(printed.macro, 0)} > 0) {{ in.{printed.measured}[0] = ({printed.real})NAN; }}"]
        spoil += [f"if ({at(printed.macro, 1)} > 0) {{ in.r[0] = ({printed.real})NAN; }}"]
        place = len(entries)
        for name, rows in _of_the_shell(held.around):
            whole = name != "bump"
            for i in range(len(rows)):
                member = f"c.{name}[{i}]" if name in ("bump", "repeats") else f"c.{name}"
                load.append(f"{member} = ({'long' if whole else printed.real})kept[{place}];")
                store.append(f"kept[{place}] = (double){member};")
                place += 1
        if loop.around.longest is not None and loop.around.band is None:
            load.append(f"c.fade = c.fade_left > 0 ? {printed.macro}_FADE : 0;")
    return filled(
        "adapter.c",
        name=printed.name,
        macro=printed.macro,
        real=printed.real,
        measured=printed.measured,
        u=printed.contents.layout.u.name,
        told=told,
        timer_status="JITTER" if around is not None and around.band is not None else "WRONG_SAMPLE_TIME",
        idle=idle,
        sample_time=sample_time,
        load=indented(load),
        spoil=indented(spoil),
        store=indented(store),
    )


def _bits(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values, dtype=float).view(np.int64)
