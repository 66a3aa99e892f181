"""What a controller can be exported to. A target is a folder: in this package, or in another distribution.

The folder has a module ``target`` with ``TARGETS``, a tuple of ``Target``s. Another distribution declares its package as an
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
    """What is to be exported; the fields are the arguments of ``export_controller``."""

    problem: TrackingProblem
    controller: Controller
    simulation: Simulation
    float32: bool
    closed_loop: bool
    sources_only: bool
    place: int
    name: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Target:
    """One value of ``--target``. Its module imports what it needs only when files are made: the command's help lists all targets.

    name      by which users ask for it
    help      what they get, in one phrase
    files     the files' contents by their names; raises InputError for what the target can't take
    check     the shell command that checks an export, from the folder, quoted, and whether the closed loop is in it
    float32   whether its numbers have 32 bits, whatever is asked for
    compiles  whether the files hold binaries for this machine, which ``sources_only`` leaves out
    replaced  names of an earlier export's files that go with it, made this time or not
    joined    of the folder and of the files made, further files that join them with exports that stand in the folder already
    """

    name: str
    help: str
    files: Callable[[Request], Mapping[str, str | bytes]]
    check: Callable[[str, bool], str]
    float32: bool = False
    compiles: bool = False
    replaced: tuple[str, ...] = ()
    joined: Callable[[Path, Mapping[str, str | bytes]], Mapping[str, str | bytes]] = lambda _folder, _made: {}


def targets() -> dict[str, Target]:
    """All targets by their names; InputError for an entry point that can't be imported."""
    return {one.name: one for found in slices("barbalat.export", GROUP, "target") for one in found.TARGETS}


def require_case(problem: TrackingProblem, simulation: Simulation) -> None:
    """InputError where these are no problem and no simulation."""
    validate.instance("problem", problem, TrackingProblem)
    validate.instance("simulation", simulation, Simulation)
