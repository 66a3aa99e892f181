"""``export_controller``: a controller of a problem as source, into a folder."""

from __future__ import annotations

from pathlib import Path

from barbalat import validate
from barbalat.export import TARGETS
from barbalat.export.contents import Contents
from barbalat.export.header import header
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


def files(problem: TrackingProblem, controller: Controller, simulation: Simulation, *, float32: bool = False) -> dict[str, str]:
    """The files of an export by their names, in C99; InputError as of ``export_controller``."""
    validate.instance("problem", problem, TrackingProblem)
    validate.instance("simulation", simulation, Simulation)
    printed = Printed(Contents.of(problem, controller, simulation, FLOAT if float32 else DOUBLE))
    return {
        "controller.h": header(printed),
        "controller.c": source(printed),
        "selftest.c": selftest(printed),
        "README.md": readme(printed),
    }


def export_controller(
    problem: TrackingProblem,
    controller: Controller,
    simulation: Simulation,
    *,
    out: str | Path,
    target: str = "c99",
    float32: bool = False,
) -> Path:
    """Write a sampled controller as source that computes what the simulation computes, bit for bit; returns the folder.

    problem, simulation  the case whose first samples become the export's test vectors
    controller           a sampled one; a continuous one is refused
    out                  the folder; an export that is there is replaced as a whole
    target               "c99": ``controller.h``, ``controller.c``, ``selftest.c``, ``README.md``
    float32              numbers of 32 bits; the test vectors are then its own, rounded operation by operation

    Raises InputError, and leaves nothing behind, where that can't be.
    """
    if target not in TARGETS:
        raise InputError(f"target must be one of {', '.join(TARGETS)}, got {validate.show(target)}")
    made = files(problem, controller, simulation, float32=float32)
    with output_folder(Path(out)) as folder:
        for name, text in made.items():
            folder.write(name, text)
        folder.commit()
        return folder.path
