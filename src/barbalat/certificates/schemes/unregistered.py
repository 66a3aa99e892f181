"""The certificate of a controller of which no proof is known, as of a class from outside the package: what needs none.

Its loop is linearised where it rests under a constant command, by the exact Jacobians of its own equations: margins with the
estimates frozen and with the law inside, and the step that these modes bear. Everything else is said to be unknown.
"""

from __future__ import annotations

from barbalat.certificates import theorems
from barbalat.certificates.cells import advice, estimate, limits_text, margins_cell, nothing
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Entry, NotApplicable
from barbalat.certificates.linear_loops.at_rest import Rest, rest_of
from barbalat.certificates.linear_loops.margin_values import (
    KEYS_OF_MARGINS,
    add_delay_margin_adapting,
    add_margins,
    add_margins_of_each,
)
from barbalat.certificates.quantities import EACH_INPUT
from barbalat.certificates.requested_keys import is_needed
from barbalat.certificates.step_limits.oscillator import largest_step
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation

NONE_KNOWN = "none known"
WHOLE_LOOP = "the whole loop, plant included"
MANY_RESTS = "it differs between the places at which the loop rests, of which there are many"


def certificate(problem: TrackingProblem, controller: Controller, simulation: Simulation) -> Certificate:
    """Margins and the step's limit by exact linearisation."""
    draft = Draft()
    draft.note(f"of {type(controller).__name__} no proof is known: what follows is computed from its equations alone")
    draft.missing("error_bound", NONE_KNOWN, theorem=theorems.UNKNOWN_LAW)
    add_linearised(draft, problem, controller, simulation)
    return draft.finish()


def add_linearised(
    draft: Draft, problem: TrackingProblem, controller: Controller, simulation: Simulation, *, bent: str = ""
) -> None:
    """Add what follows from the equations alone: margins, and the step that the modes bear.

    ``bent`` says why the law has no slope where the loop rests.
    """
    loop = ClosedLoop.of(problem, controller)
    moving = rest_of(problem, loop, frozen=False)
    still = rest_of(problem, loop, frozen=True) if isinstance(moving, NotApplicable) and loop.parameters else moving
    _add_margins(draft, problem, loop, moving, still, bent)
    _add_step(draft, simulation, moving)


def add_step_of_modes(draft: Draft, problem: TrackingProblem, controller: Controller, simulation: Simulation) -> None:
    """The step that the loop's modes bear; where a part of the loop has a limit in the draft already, the smaller of the two."""
    of_a_part = draft.get("step_max")
    _add_step(draft, simulation, rest_of(problem, ClosedLoop.of(problem, controller), frozen=False), of_a_part)


def _add_step(draft: Draft, simulation: Simulation, moving: Rest | NotApplicable, of_a_part: float | None = None) -> None:
    if isinstance(moving, NotApplicable):
        if of_a_part is None:
            draft.missing("step_max", moving.why)
    elif moving.modes.any():
        step = largest_step(simulation, moving.modes)
        if of_a_part is not None and of_a_part <= step:
            return
        rests_on = (
            f"step_max is that of the loop linearised {_at(moving)}, by exact Jacobians, without delay and limits: an estimate "
            "for the loop in motion"
        )
        draft.estimate({"step_max": step}, rests_on, of=WHOLE_LOOP, rest=moving.found)


def _add_margins(
    draft: Draft, problem: TrackingProblem, loop: ClosedLoop, moving: Rest | NotApplicable, still: Rest | NotApplicable, bent: str
) -> None:
    if _add_frozen(draft, problem, loop, still) and loop.inputs == 1 and loop.parameters:
        _add_adapting(draft, problem, moving, bent)


def _add_adapting(draft: Draft, problem: TrackingProblem, moving: Rest | NotApplicable, bent: str = "") -> None:
    if isinstance(moving, NotApplicable) or bent:
        draft.missing("delay_margin_adapting", moving.why if isinstance(moving, NotApplicable) else bent)
    elif moving.is_one_of_many:
        draft.missing("delay_margin_adapting", f"{MANY_RESTS}: one is {_at(moving)}{moving.place}")
    elif moving.level.any():
        add_delay_margin_adapting(
            draft, problem, moving.broken(frozen=False), f"linearised {_at(moving)}{moving.place}", moving.found
        )


def add_at_rest(draft: Draft, problem: TrackingProblem, controller: Controller, *, none: str = "") -> None:
    """Margins with the estimates frozen and with the law inside, of a scheme of which no formula gives these loops here."""
    if is_needed(*KEYS_OF_MARGINS.values(), *EACH_INPUT.values(), "sensitivity_peak", "complementary_sensitivity_peak"):
        loop = ClosedLoop.of(problem, controller)
        _add_frozen(draft, problem, loop, rest_of(problem, loop, frozen=True))
    add_adapting(draft, problem, controller, none=none)


def add_adapting(draft: Draft, problem: TrackingProblem, controller: Controller, *, none: str = "") -> None:
    """Add the delay margin with the law inside, of one input; ``none`` says why the scheme has none, if it has none."""
    loop = ClosedLoop.of(problem, controller)
    if not is_needed("delay_margin_adapting") or loop.inputs > 1 or not loop.parameters:
        return
    if none:
        draft.missing("delay_margin_adapting", none)
        return
    with draft.part("delay_margin_adapting"):
        _add_adapting(draft, problem, rest_of(problem, loop, frozen=False))


def _add_frozen(draft: Draft, problem: TrackingProblem, loop: ClosedLoop, still: Rest | NotApplicable) -> bool:
    """Add the margins with the estimates frozen; whether the loop rests."""
    if isinstance(still, NotApplicable):
        draft.missing("delay_margin", still.why)
        return False
    which = f"{'with its estimates frozen, ' if loop.parameters else ''}linearised {_at(still)}{still.place}"
    if loop.inputs > 1:
        draft.missing("delay_margin", "of one delay in all inputs it is not known; delay_margin_each is of each alone")
        add_margins_of_each(draft, problem, [still.broken_at(i, frozen=True) for i in range(loop.inputs)], which, still.found)
    else:
        add_margins(draft, problem, still.broken(frozen=True), which, rest=still.found)
    return True


def _at(rest: Rest) -> str:
    values = ", ".join(f"{value:g}" for value in rest.level)
    return f"at the constant command {values}" if rest.level.any() else "at rest"


def column(problem: TrackingProblem, controller: Controller, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The class's name, and cells that claim nothing but what was computed."""
    estimates = ClosedLoop.of(problem, controller).parameters
    unknown = {key: nothing(key, NONE_KNOWN) for key in ("stability", "tracking", "transient", "estimates", "modelling_error")}
    return type(controller).__name__, {
        **unknown,
        **({} if estimates else {"estimates": advice("estimates", "it estimates nothing")}),
        "tuning": estimate("tuning", limits_text(certificate)),
        "margins": margins_cell(certificate),
    }
