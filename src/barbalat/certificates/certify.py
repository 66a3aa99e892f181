"""The certificate of each controller of a problem, assembled from conditions, bounds, limits and margins."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

from barbalat import budget
from barbalat.certificates.apart import apart, further_blocks, with_notes
from barbalat.certificates.cells import on_damping
from barbalat.certificates.certificate import Certificate, reason
from barbalat.certificates.certificates import Certificates, Table1, column_of, file_of, table_1
from barbalat.certificates.entry import speaks_of_the_motion
from barbalat.certificates.linear_loops.over_ranges import with_margins_over_ranges
from barbalat.certificates.requested_keys import needing
from barbalat.certificates.schemes.sampled_loop import linear_because
from barbalat.loop.binding import bound, is_sampled, numbered
from barbalat.loop.user_errors import named
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Assuming, Controller, DiscretizedEquations
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError, counted


def with_note_on_runs(
    problem: TrackingProblem, controller: Controller, certificate: Certificate, simulation: Simulation
) -> Certificate:
    """The certificate of a controller in continuous time, with a note if a numerical run may leave the guaranteed bounds.

    A run may leave the bounds if the smallest step limit is exceeded or unknown, whatever the scheme; the cells of Table 1 are
    guarantees like the entries.
    """
    keys = ("step_max", "step_max_at_model")  # between these two steps a run may or may not stay within the bounds
    limits = [limit for limit in (certificate.values.get(key) for key in keys) if limit is not None]
    if limits and simulation.dt <= limits[0]:
        return certificate
    cells = column_of(problem, controller, certificate).cells
    if not any(map(speaks_of_the_motion, (*certificate.entries, *cells.values()))):
        return certificate
    if not limits:
        note = "no limit on the step is known: the guarantees hold for the equations' solution, from which a run may deviate"
    else:
        about = " to ".join(f"{limit:.3g}" for limit in limits)
        note = (
            f"at dt = {simulation.dt:g} s {simulation.solver.name} need not follow the equations: its limit is about {about} s. "
            "The guarantees hold for their solution, from which a run at this step may deviate"
        )
    return certificate.with_entries(certificate.entries, note)


def certify(
    problem: TrackingProblem,
    controllers: Controller | Iterable[Controller],
    simulation: Simulation,
    *,
    keys: Collection[str] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Certificates:
    """Return the certificates by controller name, in a dictionary; nothing is simulated, and the limits are those of the given
    solver and step.

    For a class from outside the package, a certificate contains the values that need no proof; the rest is marked as unknown. If
    a certificate cannot be computed with the case's numbers, its finding says so. Raises InputError, with the name, for a
    controller that does not fit the problem and could not be simulated either. ``progress`` is called with the completed
    fraction. If only some ``keys`` are needed, certificates may lack others, such as searches over the known set and limits along
    the command.

    The values follow from the plant and the declared sets alone; values that the simulated plant voids are marked "guaranteed for
    the design", with the reason in the notes. With faults, all values are those of the loop without faults.
    """
    found, told, design = {}, numbered(controllers), problem.design
    if keys is None:
        _require_room(problem, len(told))
    for i, controller in enumerate(told, start=1):
        with named(controller.name), needing(keys):
            found[controller.name] = _computed(design, controller, simulation)
        if progress is not None:
            progress(i / len(told))
    checked = apart(problem, told, found, partial(_computed, simulation=simulation))
    noted, cells = with_notes(problem, found, checked), {} if checked is None else checked.cells
    return Certificates(noted, design, told, simulation, further_blocks(problem, checked), cells, plain=found)


def _require_room(problem: TrackingProblem, controllers: int) -> None:
    """Raise InputError if the certificates of this number of controllers exceed the budget; announce work of more than a few
    seconds."""
    budget.require(
        "the plant",
        len(problem.dynamics.x0),
        lambda states: budget.of_certificate(states).times(controllers),
        given=f"has {counted(len(problem.dynamics.x0), 'state')}, and {counted(controllers, 'certificate')}",
        fits=lambda most: f"at most {counted(most, 'state')}",
        what=f"{counted(controllers, 'certificate')} for a plant of {counted(len(problem.dynamics.x0), 'state')}",
    )


def certify_where_possible(
    problem: TrackingProblem,
    controllers: Sequence[Controller],
    simulation: Simulation,
    progress: Callable[[float], None] = lambda _: None,
) -> dict[str, Certificate]:
    """Certify for a report: if a controller cannot be certified, its finding gives the reason."""
    found = {}
    for i, controller in enumerate(controllers):
        progress(i / len(controllers))
        try:
            found[controller.name] = _computed(problem.design, controller, simulation)
        except Exception as error:  # noqa: BLE001 (a report of runs is not lost to a fault of ours)
            found[controller.name] = Certificate.failed(reason(error))
    return found


def _computed(problem: TrackingProblem, controller: Controller, simulation: Simulation) -> Certificate:
    """Certify loops in which every sample arrives and is used."""
    equations = bound(problem, controller)  # rejects a controller that does not fit
    found = _of_nominal(problem.nominal, controller, simulation)
    equations = equations.continuous if isinstance(equations, DiscretizedEquations) else equations
    assumed = equations.assumed if isinstance(equations, Assuming) else None
    return found if assumed is None else found.with_entries(found.entries, assumed)


def _of_nominal(problem: TrackingProblem, controller: Controller, simulation: Simulation) -> Certificate:
    """Overflows, singular or non-finite matrices, and norms beyond the limit of precision are findings of the case."""
    try:
        sampled = is_sampled(bound(problem, controller))  # rejects a controller that does not fit
        if simulation.tolerance is not None:
            return _without_step(_of_nominal(problem, controller, simulation.grid))
        found = file_of(problem, controller).certificate(problem, controller, simulation)
        linear = linear_because(problem, controller) is not None
        found = with_margins_over_ranges(found, problem, controller, linear=linear)
        if sampled:
            return found
        found = found if simulation.solver.imaginary_limit else on_damping(found)
        return with_note_on_runs(problem, controller, found, simulation)
    except InputError:
        raise
    except (ArithmeticError, ValueError) as error:  # NumPy's LinAlgError is a ValueError
        return Certificate.failed(reason(error))


STEP_KEYS = ("step_max", "gamma_max", "step_max_at_model", "gamma_max_at_model")
"""Entries on the limits of a fixed step, which do not apply to a variable-step run."""


def _without_step(certificate: Certificate) -> Certificate:
    """The certificate for variable-step runs."""
    entries = tuple(entry for entry in certificate.entries if entry.key not in STEP_KEYS)
    notes = tuple(
        note for note in certificate.notes if not any(word in note for word in (*STEP_KEYS, "limit on the step", "at dt ="))
    )
    return replace(certificate, entries=entries, notes=notes)


class Certified(NamedTuple):
    """The certificates by the names under which they are shown, and Table 1 of the schemes."""

    certificates: dict[str, Certificate]
    table: Table1
    further_blocks: dict[str, Any] = {}  # noqa: RUF012 (never changed): the sets derived from ranges, and the check of the truth

    def as_document(self, case: str) -> dict[str, Any]:
        """The document of ``certify --json``."""
        controllers = {name: certificate.as_json() for name, certificate in self.certificates.items()}
        return {"case": case, "controllers": controllers, "table_1": self.table.as_json(), **self.further_blocks}

    def as_json(self) -> dict[str, Any]:
        certificates = {n: c.as_json() for n, c in self.certificates.items()}
        return {"certificates": certificates, "table_1": self.table.as_json(), **self.further_blocks}


def certified_case(
    problem: TrackingProblem,
    controllers: Sequence[Controller],
    simulation: Simulation,
    progress: Callable[[float], None] = lambda _: None,
) -> Certified:
    """Certificates of all controllers; if a controller cannot be certified, its finding gives the reason."""
    certificates = certify_where_possible(problem, controllers, simulation, progress)
    checked = apart(problem, controllers, certificates, partial(_computed, simulation=simulation))
    noted = with_notes(problem, certificates, checked)
    cells = {} if checked is None else checked.cells
    return Certified(noted, table_1(problem.design, controllers, certificates, cells), further_blocks(problem, checked))
