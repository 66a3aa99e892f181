"""``export_controller``: a controller of a problem as source or as units of FMI, into a folder."""

from __future__ import annotations

from pathlib import Path

from barbalat import validate
from barbalat.export import TARGETS
from barbalat.export.contents import Contents
from barbalat.export.fmu.archive import Archive
from barbalat.export.fmu.units import Unit
from barbalat.export.header import header
from barbalat.export.loop_program import loop_program
from barbalat.export.parameters import Opened
from barbalat.export.plant import PlantContents
from barbalat.export.plant_source import PrintedPlant, plant_header, plant_source
from barbalat.export.readme import readme
from barbalat.export.selftest import selftest
from barbalat.export.source import source
from barbalat.export.texts import Printed
from barbalat.lowering.c99 import DOUBLE, FLOAT
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.report.files import output_folder
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError

OF_A_LOOP = ("plant.h", "plant.c", "loop.c")
VERSIONS = {"fmu2": 2, "fmu3": 3}


def files(
    problem: TrackingProblem, controller: Controller, simulation: Simulation, *, float32: bool = False, closed_loop: bool = False
) -> dict[str, str]:
    """The files of an export by their names, in C99; InputError as of ``export_controller``."""
    _require(problem, simulation)
    printed = Printed(Contents.of(problem, controller, simulation, FLOAT if float32 else DOUBLE))
    found = {
        "controller.h": header(printed),
        "controller.c": source(printed),
        "selftest.c": selftest(printed),
        "README.md": readme(printed, closed_loop=closed_loop),
    }
    if closed_loop:
        opened = Opened.of(problem, controller, simulation, tunable=False)
        made = PrintedPlant(PlantContents.of(problem, opened), printed)
        found |= {"plant.h": plant_header(made), "plant.c": plant_source(made), "loop.c": loop_program(made)}
    return found


def units(
    problem: TrackingProblem,
    controller: Controller,
    simulation: Simulation,
    *,
    version: int,
    float32: bool = False,
    closed_loop: bool = False,
    compiled: bool = True,
    place: int = 0,
) -> dict[str, bytes]:
    """The units of an export by their names, in version 2 or 3 of FMI; InputError as of ``export_controller``."""
    _require(problem, simulation)
    opened = Opened.of(problem, controller, simulation, tunable=True, place=place)
    printed = Printed(Contents.of(problem, controller, simulation, FLOAT if float32 else DOUBLE, opened=opened))
    made = [Unit(printed, True, None)]
    if closed_loop:
        plant = PrintedPlant(PlantContents.of(problem, opened), printed)
        made += [Unit(printed, False, plant), Unit(printed, True, plant)]
    return {f"{unit.identifier}.fmu": Archive(unit, version, simulation.t_end).bytes(compiled=compiled) for unit in made}


def export_controller(
    problem: TrackingProblem,
    controller: Controller,
    simulation: Simulation,
    *,
    out: str | Path,
    target: str = "c99",
    float32: bool = False,
    closed_loop: bool = False,
    sources_only: bool = False,
    place: int = 0,
) -> Path:
    """Write a sampled controller as source that computes what the simulation computes, bit for bit; returns the folder.

    problem, simulation  the case whose first samples become the export's test vectors
    controller           a sampled one; a continuous one is refused
    out                  the folder; an export that is there is replaced as a whole
    target               "c99": ``controller.h``, ``controller.c``, ``selftest.c``, ``README.md``; "fmu2", "fmu3": a unit for
                         Co-Simulation by FMI 2.0 or 3.0, whose gains, limits and initial estimates are parameters
    float32              numbers of 32 bits; the test vectors are then its own, rounded operation by operation
    closed_loop          the plant and the whole loop as well: ``plant.h``, ``plant.c`` and ``loop.c``, or a unit of each
    place                of the controller in its case: the parameters of units go by the case's paths, ``controller[0].gamma``
    sources_only         units without a binary for this machine, for which a C compiler is needed

    Raises InputError, and leaves nothing behind, where that can't be.
    """
    if target not in TARGETS:
        raise InputError(f"target must be one of {', '.join(TARGETS)}, got {validate.show(target)}")
    if sources_only and target == "c99":
        raise InputError("sources_only is for units of FMI: the target c99 is sources anyway")
    made: dict[str, str] | dict[str, bytes]
    if target == "c99":
        made = files(problem, controller, simulation, float32=float32, closed_loop=closed_loop)
    else:
        made = units(
            problem,
            controller,
            simulation,
            version=VERSIONS[target],
            float32=float32,
            closed_loop=closed_loop,
            compiled=not sources_only,
            place=place,
        )
    with output_folder(Path(out)) as folder:
        for name, content in made.items():
            folder.write(name, content)
        folder.commit(gone=OF_A_LOOP if target == "c99" else ())
        return folder.path


def _require(problem: TrackingProblem, simulation: Simulation) -> None:
    validate.instance("problem", problem, TrackingProblem)
    validate.instance("simulation", simulation, Simulation)
