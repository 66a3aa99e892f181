"""What is guaranteed of the equations' solution, beside runs at a step that the solver does not bear, or may not bear."""

from __future__ import annotations

from barbalat.certificates.certificate import Certificate
from barbalat.certificates.columns import column_of
from barbalat.certificates.entry import NUMBERS_ALONE, Entry
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation


def beside_its_runs(
    problem: TrackingProblem, controller: Controller, certificate: Certificate, simulation: Simulation
) -> Certificate:
    """The certificate of a controller in continuous time, with a note where a run may leave what is guaranteed of the solution.

    That is where the least limit of the step is exceeded, or where none is known, whatever the scheme; the cells of Table 1 are
    guarantees as the entries are.
    """
    keys = ("step_max", "step_max_at_model")  # between the two a run may or may not follow
    limits = [limit for limit in (certificate.values.get(key) for key in keys) if limit is not None]
    if limits and simulation.dt <= limits[0]:
        return certificate
    cells = column_of(problem, controller, certificate).cells
    if not any(map(_speaks_of_the_motion, (*certificate.entries, *cells.values()))):
        return certificate
    if not limits:
        note = "no limit of the step is known: what is guaranteed is so of the equations' solution, and a run may leave it"
    else:
        about = " to ".join(f"{limit:.3g}" for limit in limits)
        note = (
            f"at dt = {simulation.dt:g} s {simulation.solver.name} need not follow the equations: its limit is about {about} s. "
            "What is guaranteed is so of their solution, and a run at this step may leave it"
        )
    return certificate.with_entries(certificate.entries, note)


def _speaks_of_the_motion(entry: Entry) -> bool:
    """A norm or a condition follows from the case's numbers alone, and no run can contradict it."""
    return entry.kind == "guaranteed" and entry.value is not None and entry.rests_on != (NUMBERS_ALONE,)
