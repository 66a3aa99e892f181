"""``export_controller``: a sampled controller, made executable on another target, in a folder."""

from __future__ import annotations

from pathlib import Path

from barbalat import validate
from barbalat.export.layout import require_prefix
from barbalat.export.target import Request, require_case, targets
from barbalat.folders import output_folder
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError


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
    name: str | None = None,
) -> Path:
    """Write a sampled controller as source that computes what the simulation computes, bit for bit; returns the folder.

    problem, simulation  the case whose first samples become the export's test vectors
    controller           a sampled one; a continuous one is refused
    out                  the folder; an export that is there is replaced as a whole
    target               "c99": ``controller.h``, ``controller.c``, ``selftest.c``, ``README.md``; "fmu2", "fmu3": a unit for
                         Co-Simulation by FMI 2.0 or 3.0, whose gains, limits and initial estimates are parameters;
                         "ardupilot": a backend of AC_CustomControl for one axis, in 32 bits;
                         "rust": the C in a crate without dependencies, with a safe wrapper
    float32              numbers of 32 bits; the test vectors are then its own, rounded operation by operation
    closed_loop          the plant and the whole loop as well: ``plant.h``, ``plant.c`` and ``loop.c``, or a unit of each
    place                of the controller in its case: the parameters of units go by the case's paths, ``controller[0].gamma``
    name                 what functions, types, macros and files begin with, so that several exports can be linked; by default
                         the identifiers are made of the controller's name, and the files have none. C99 exports with names of
                         their own in one folder are joined by ``controllers.h``, ``CMakeLists.txt`` and ``README.md``
    sources_only         units without a binary for this machine, for which a C compiler is needed

    Raises InputError, and leaves nothing behind, where that can't be.
    """
    known = targets()
    if target not in known:
        raise InputError(f"target must be one of {', '.join(known)}, got {validate.show(target)}")
    chosen = known[target]
    if sources_only and not chosen.compiles:
        raise InputError(f"sources_only is for units of FMI: the target {target} is sources anyway")
    into = validate.local_path("out", out)
    require_case(problem, simulation)
    made = chosen.files(
        Request(
            problem=problem,
            controller=controller,
            simulation=simulation,
            float32=float32,
            closed_loop=closed_loop,
            sources_only=sources_only,
            place=place,
            name="" if name is None else require_prefix(name),
        )
    )
    with output_folder(into) as folder:
        for file, content in made.items():
            folder.write(file, content)
        for file, content in chosen.joined(folder.path, made).items():
            folder.write(file, content)
        folder.commit(gone=chosen.replaced)
        return folder.path
