"""The certificates of the schemes: each file has the name of the controller's file in ``barbalat.controllers``."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any, Protocol, cast, runtime_checkable

from barbalat.certificates.bounds.known_command import KnownLoop
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.entry import Entry
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation

CONTROLLERS = "barbalat.controllers."


class SchemeFile(Protocol):
    """The functions of a scheme's file; they are called only with controllers of the scheme and problems that these controllers
    support."""

    def certificate(self, problem: TrackingProblem, controller: Controller, simulation: Simulation) -> Certificate:
        """The certificate, computed before any run."""
        ...

    def column(self, problem: TrackingProblem, controller: Controller, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
        """The scheme's name in Table 1, and its cells by the keys of PROPERTIES."""
        ...


@runtime_checkable
class HeldFile(SchemeFile, Protocol):
    """The file of a scheme that integrates only its law, so that the motion of the plant between Euler steps is exact."""

    def held_limits(
        self, problem: TrackingProblem, controller: Controller, simulation: Simulation, nu_0: float
    ) -> dict[str, Any]:
        """gamma_max and step_max of the sampled law; the sample time is the step of the simulation."""
        ...


@runtime_checkable
class ProvenFile(SchemeFile, Protocol):
    """The file of a scheme whose guarantees can be checked independently."""

    def grounds(self, problem: TrackingProblem, controller: Controller, simulation: Simulation) -> dict[str, Any]:
        """The numbers on which the guarantees rest; ``scheme`` is the name of the rules that apply to it."""
        ...


@runtime_checkable
class FollowedFile(ProvenFile, Protocol):
    """The file of a scheme whose error can be computed from a linear loop, which is evaluated over the whole known set."""

    def known_loop(self, problem: TrackingProblem, controller: Controller) -> KnownLoop | None:
        """The loop; None if the plant has no such loop."""
        ...


@runtime_checkable
class LinearFile(SchemeFile, Protocol):
    """The file of a scheme that may be linear and time-invariant; the loop of its sampled form is then known exactly."""

    def linear_when(self, problem: TrackingProblem, controller: Controller) -> str | None:
        """The reason why the continuous controller is linear on this plant, as a sentence; None if it is not linear."""
        ...


def scheme_file(controller: Controller) -> SchemeFile | None:
    """The certificate's file for a controller's scheme; None if there is none (see ``unregistered``).

    A subclass has its base scheme's certificate unless it binds other equations.
    """
    bind = type(controller).bind
    for kind in type(controller).__mro__:
        name = f"{__name__}.{kind.__module__.removeprefix(CONTROLLERS)}"
        if kind.__module__.startswith(CONTROLLERS) and vars(kind).get("bind") is bind and find_spec(name) is not None:
            return cast("SchemeFile", import_module(name))
    return None
