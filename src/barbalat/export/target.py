"""Targets to which a controller can be exported. A target is a folder in this package or in a different distribution.

The folder has a module ``target`` with ``TARGETS``, a tuple of ``Target``s. A different distribution declares its package as an
entry point, ``[project.entry-points."barbalat.export_targets"]`` with ``any_name = "its_package"``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from barbalat import validate
from barbalat.discovery import slices
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation

GROUP = "barbalat.export_targets"


@dataclass(frozen=True, eq=False, kw_only=True)
class Request:
    """The request for an export; the fields are the arguments of ``export_controller``.

    warning  a function that returns a sentence if the run of the case is lost or rejected, otherwise an empty text; it is called
             once the export is known to be possible
    """

    problem: TrackingProblem
    controller: Controller
    simulation: Simulation
    float32: bool = False
    closed_loop: bool = False
    sources_only: bool = False
    place: int = 0
    name: str = ""
    parameters: bool = False
    warning: Callable[[], str] = lambda: ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Target:
    """One value of ``--target``. Its module imports other modules only when files are made, because the command's help lists all
    targets.

    name      name in --target
    help      what the user gets, in one phrase
    files     contents of the files keyed by name; raises InputError for an unsupported request
    check     the shell command that checks an export, given the quoted folder and whether it contains the closed loop
    float32   whether numbers always have 32 bits
    parameters  whether numbers of the case can be run-time parameters; FMUs always have them
    handed    whether the control of an external baseline can be an input
    compiles  whether the files contain binaries for this machine, which ``sources_only`` omits
    replaced  names of files of an earlier export that are removed even if they are not written again
    joined    a function from the folder and the new files to further files that join them with exports already in the folder
    """

    name: str
    help: str
    files: Callable[[Request], Mapping[str, str | bytes]]
    check: Callable[[str, bool], str]
    float32: bool = False
    parameters: bool = False
    handed: bool = False
    compiles: bool = False
    replaced: tuple[str, ...] = ()
    joined: Callable[[Path, Mapping[str, str | bytes]], Mapping[str, str | bytes]] = lambda _folder, _made: {}


def targets() -> dict[str, Target]:
    """All targets keyed by name; raises InputError for an entry point that can't be imported."""
    return {one.name: one for found in slices("barbalat.export", GROUP, "target") for one in found.TARGETS}


def require_case(problem: TrackingProblem, simulation: Simulation) -> None:
    """Raise InputError unless these are a problem and a simulation."""
    validate.instance("problem", problem, TrackingProblem)
    validate.instance("simulation", simulation, Simulation)
