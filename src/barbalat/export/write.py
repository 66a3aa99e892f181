"""``export_controller`` writes a sampled controller as source code for a different target into a folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

from barbalat import validate
from barbalat.export.layout import require_prefix
from barbalat.export.target import Request, require_case, targets
from barbalat.folders import output_folder
from barbalat.judge.settings import Judge
from barbalat.judge.verdict import Class, Verdict
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.simulate import simulate, with_missed_samples
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
    parameters: bool = False,
    judge: Judge | None = None,
    note: Callable[[str], None] = lambda _: None,
) -> Path:
    """Write a sampled controller as source code that computes the same as the simulation, bit for bit; returns the folder.

    problem, simulation  the case whose first samples become the test vectors of the export
    controller           a sampled controller; continuous controllers are rejected
    out                  the folder; an existing export in it is replaced completely
    target               "c99": ``controller.h``, ``controller.c``, ``selftest.c``, ``README.md``; "fmu2", "fmu3": an FMU for FMI
                         2.0 or 3.0 Co-Simulation, whose gains, limits and initial estimates are parameters; "ardupilot": a
                         backend of AC_CustomControl for one axis, in 32 bits; "rust": the C in a crate without dependencies, with
                         a safe wrapper
    float32              numbers of 32 bits; the test vectors are then computed in 32 bits, operation by operation
    closed_loop          also export the plant and the whole loop, as ``plant.h``, ``plant.c`` and ``loop.c`` or as FMUs
    place                index of the controller in its case; parameters of FMUs are named by their paths in the case, such as
                         ``controller[0].gamma``
    name                 prefix of functions, types, macros and files, so that several exports can be linked; by default the
                         identifiers are derived from the controller's name, and the files have no prefix. C99 exports with
                         different names in one folder are joined by ``controllers.h``, ``CMakeLists.txt`` and ``README.md``
    parameters           make gains, limits and initial estimates parameters that can be set within bounds while the C code runs;
                         in FMUs they are always parameters
    sources_only         write FMUs without a binary for this machine, which would require a C compiler
    judge                the criteria for the verdict on the simulation of the case, as in ``simulate``
    note                 called with a sentence if the controller is lost in that run or the shell rejects samples of it; the
                         README also contains the sentence

    Raises InputError, and leaves no files behind, if the export is impossible.
    """
    known = targets()
    if target not in known:
        raise InputError(f"target must be one of {', '.join(known)}, got {validate.show(target)}")
    chosen = known[target]
    if sources_only and not chosen.compiles:
        raise InputError(f"sources_only is for FMUs: the target {target} always has sources")
    if parameters and not chosen.parameters:
        able = ", ".join(one.name for one in known.values() if one.parameters)
        raise InputError(f"parameters can be added only for the target {able} (FMUs always have them), got {target}")
    into = validate.local_path("out", out)
    require_case(problem, simulation)
    if problem.handed_controls and not chosen.handed:
        able = ", ".join(one.name for one in known.values() if one.handed)
        raise InputError(f"baseline.external = true makes u_baseline an input of the target {able} alone; got {target}")
    warning = cache(partial(own_run_warning, problem, controller, simulation, judge))
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
            parameters=parameters,
            warning=warning,
        )
    )
    if warning():
        note(warning())
    with output_folder(into) as folder:
        for file, content in made.items():
            folder.write(file, content)
        for file, content in chosen.joined(folder.path, made).items():
            folder.write(file, content)
        folder.commit(gone=chosen.replaced)
        return folder.path


MOST_OF_THE_TIME = 0.5
"""Fraction of the time at the actuator limits above which a run with the verdict *off* is reported, because the limits and not
the law determine u."""

AFTER_A_BIT_ERROR = (
    "After a bit error in the last good value the shell can reject good samples for a long time: give a range as well."
)


def own_run_warning(problem: TrackingProblem, controller: Controller, simulation: Simulation, judge: Judge | None) -> str:
    """A warning about the simulation of the case with this controller; empty if there is none. It warns of a run that is lost or
    diverges, ends in a limit cycle, or is off and mostly at its limits, and of a shell that rejects samples of that run without
    faults or has a rate without a range."""
    (run,) = simulate(problem, [controller], simulation, judge=judge).values()
    if run.verdict is not None and run.verdict.kind is Class.LOST:
        return f"Do not fly this export as it is: when this case is simulated, {controller.name} is {run.verdict}."
    said = []
    if run.verdict is not None and _is_poor(run.verdict):
        said.append(f"When this case is simulated, the judge's verdict on {controller.name} is: {run.verdict}.")
    if problem.shell is not None:
        if problem.faults:
            run = simulate(replace(problem, faults=()), [controller], simulation)[controller.name]  # type: ignore[type-var]
        missed = with_missed_samples({controller.name: run})[controller.name].missed
        told = None if missed is None else missed.sentence
        said += [f"When this case is simulated without faults, {told}: widen the limits of the shell."] if told else []
        alone = ", ".join(name for name in problem.shell.rate if name not in problem.shell.range)
        said += [f"shell.rate is given for {alone}, but shell.range is not. {AFTER_A_BIT_ERROR}"] if alone else []
    return " ".join(said)


def _is_poor(verdict: Verdict) -> bool:
    mostly = max(verdict.at_limit, default=0.0) >= MOST_OF_THE_TIME
    return verdict.kind is Class.CYCLE or (verdict.kind is Class.OFF and mostly)
