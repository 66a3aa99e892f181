"""The certificate of each controller of a problem, put together from conditions, bounds, limits and margins."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence

from barbalat.certificates.beside_runs import beside_its_runs
from barbalat.certificates.cells import on_damping
from barbalat.certificates.certificate import Certificate, reason
from barbalat.certificates.certificates import Certificates
from barbalat.certificates.needed import needing
from barbalat.certificates.schemes import scheme_file, stranger
from barbalat.loop.binding import bound, is_sampled, numbered
from barbalat.loop.blame import named
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError


def certify(
    problem: TrackingProblem,
    controllers: Controller | Iterable[Controller],
    simulation: Simulation,
    *,
    keys: Collection[str] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Certificates:
    """Certificates by the controllers' names, a dictionary; nothing is simulated, the solver and its step are what is judged.

    Of a class from outside the package what needs no proof is given; the rest is said to be unknown. A certificate whose
    computation fails on the case's numbers has that as its finding. Raises InputError, with its name, for a controller that
    does not fit the problem: no run of it is possible either. ``progress`` is called with the fraction done. Where only some
    ``keys`` are needed, certificates may lack others: searches over the known set, limits along the command.
    """
    found, told = {}, numbered(controllers)
    for i, controller in enumerate(told, start=1):
        with named(controller.name), needing(keys):
            found[controller.name] = _computed(problem, controller, simulation)
        if progress is not None:
            progress(i / len(told))
    return Certificates(found, problem, told, simulation)


def certify_where_possible(
    problem: TrackingProblem,
    controllers: Sequence[Controller],
    simulation: Simulation,
    progress: Callable[[float], None] = lambda _: None,
) -> dict[str, Certificate]:
    """Certify for a report: a controller that can't be certified, for whatever reason, has the reason as its finding."""
    found = {}
    for i, controller in enumerate(controllers):
        progress(i / len(controllers))
        try:
            found[controller.name] = _computed(problem, controller, simulation)
        except Exception as error:  # noqa: BLE001 (a report of runs is not lost to a fault of ours)
            found[controller.name] = Certificate.failed(reason(error))
    return found


def _computed(problem: TrackingProblem, controller: Controller, simulation: Simulation) -> Certificate:
    """Overflows, matrices that are singular or not finite, norms beyond the limit of precision are findings of the case."""
    try:
        sampled = is_sampled(bound(problem, controller))  # refuses what does not fit
        found = (scheme_file(controller) or stranger).certificate(problem, controller, simulation)
        if sampled:
            return found
        found = found if simulation.solver.imaginary_limit else on_damping(found)
        return beside_its_runs(problem, controller, found, simulation)
    except InputError:
        raise
    except (ArithmeticError, ValueError) as error:  # NumPy's LinAlgError is a ValueError
        return Certificate.failed(reason(error))
