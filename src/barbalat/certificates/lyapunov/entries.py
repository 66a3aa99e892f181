"""The entries and cells that follow if an author's Lyapunov function is proven, and the reason if it is not."""

from __future__ import annotations

from typing import NamedTuple

from barbalat.certificates import theorems
from barbalat.certificates.assumptions import nominal, projected_onto, theta_in_the_set
from barbalat.certificates.bounds.known_command import KEY
from barbalat.certificates.certificate import Draft
from barbalat.certificates.entry import Assumption, NotApplicable
from barbalat.certificates.lyapunov.rational import NotRational
from barbalat.certificates.lyapunov.reading import read
from barbalat.certificates.lyapunov.theorem import Refused, Shown, shown
from barbalat.certificates.quantities import Quantity
from barbalat.loop.binding import bound
from barbalat.problem.regressors import Linear
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller, LyapunovEquations
from barbalat.validate import InputError

OWN = {
    "estimates_error_bound": Quantity("bound on every component of the estimates minus theta, at all times"),
    "lyapunov_decay": Quantity("what was shown about V, the Lyapunov function supplied by the law's author"),
    "error_limit": Quantity("limit of |e| as t goes to infinity"),
}
"""The meanings of the keys that only a law with its own V has."""

EXACT_LINES = "V' <= -W holds for the code of the law, evaluated in exact arithmetic"


class Handed(NamedTuple):
    """The result for the V that a law's author supplied."""

    shown: Shown | NotApplicable
    rests_on: tuple[Assumption, ...]


def handed_in(problem: TrackingProblem, controller: Controller) -> Handed | None:
    """The result for the V of a law, or None if the law has no V."""
    if not isinstance(bound(problem, controller), LyapunovEquations):
        return None
    found = of_lines(problem, controller)
    if not isinstance(problem, Problem):
        return Handed(found, (Assumption(EXACT_LINES, "nothing is known about its V on this problem"),))
    broken = found.why if isinstance(found, NotApplicable) else ""
    rests_on = (*nominal(problem), Assumption(EXACT_LINES, broken, theorems.REFUSED_V))
    known_set = problem.known.estimate_set
    if known_set is None or isinstance(found, NotApplicable):
        return Handed(found, rests_on)
    if found.reading.normals:
        return Handed(found, (*rests_on, projected_onto(problem, known_set)))
    return Handed(found, (*rests_on, theta_in_the_set(problem)) if found.over_the_set else rests_on)


def of_lines(problem: TrackingProblem, controller: Controller) -> Shown | NotApplicable:
    """The proof from the code of the law: for every value of phi(x), which is faster, or else for phi as it is."""
    if isinstance(problem, Problem) and not isinstance(problem.plant.regressor, Linear):
        found = _shown(problem, controller, free_phi=True)
        if isinstance(found, Shown):
            return found
    return _shown(problem, controller, free_phi=False)


def _shown(problem: TrackingProblem, controller: Controller, *, free_phi: bool) -> Shown | NotApplicable:
    """Any failure to read foreign code is a finding, with its reason."""
    if not isinstance(problem, Problem):
        return NotApplicable("the V of a law is checked only for state feedback")
    known = problem.known
    if known.matched.gain_unknown or known.theta_0 is not None or known.enters is not None:
        return NotApplicable("the V of a law is checked only for a known input gain and without a baseline")
    try:
        return shown(read(problem, controller, free_phi=free_phi), problem.uncertainty)
    except (Refused, NotRational) as refused:
        return NotApplicable(str(refused))
    except InputError as refused:
        return NotApplicable(f"its code could not be read exactly: {refused}")
    except Exception as error:  # noqa: BLE001 (lines from outside, on numbers that they were not written for)
        return NotApplicable(f"its code could not be read exactly ({type(error).__name__}: {error})")


def add_bounds(draft: Draft, problem: TrackingProblem, handed: Handed) -> None:
    """Add the results of the proof for V, and the bounds on e and on the estimates."""
    found, rests_on = handed
    if isinstance(found, NotApplicable) or not isinstance(problem, Problem):
        why = found.why if isinstance(found, NotApplicable) else rests_on[-1].broken
        draft.missing("error_bound", f"the V of the law is not accepted: {why}", theorem=theorems.REFUSED_V)
        return
    draft.guarantee("lyapunov_decay", found.how, *rests_on)
    level = found.initial_level(problem.parameters)
    draft.guarantee("error_bound", found.error_bound(level), *rests_on)
    worst = None if problem.uncertainty is None else found.worst_level(problem.uncertainty)
    if worst is not None:
        for key in ("error_bound_worst", KEY):
            draft.guarantee(key, found.error_bound(worst), *rests_on, theta_in_the_set(problem))
    estimates = found.estimates_bound(level)
    if estimates is not None:
        draft.guarantee("estimates_error_bound", estimates, *rests_on)
    if found.converges:
        draft.guarantee("error_limit", 0.0, *rests_on)
