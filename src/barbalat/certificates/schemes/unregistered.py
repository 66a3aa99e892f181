"""The certificate of a controller without a known proof, such as a class from outside the package: the parts that need no proof.

The loop is linearised at its equilibrium for a constant command, by the exact Jacobians of its equations. This gives margins with
frozen estimates and with the law, and the largest step for the modes. Everything else is marked as unknown.
"""

from __future__ import annotations

from barbalat.certificates import theorems
from barbalat.certificates.cells import advice, estimate, limits_text, margins_cell, nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Entry, NotApplicable
from barbalat.certificates.linear_loops.at_rest import Rest, rest_of
from barbalat.certificates.linear_loops.margin_values import (
    KEYS_OF_MARGINS,
    add_delay_margin_adapting,
    add_margins,
    add_margins_of_each,
)
from barbalat.certificates.lyapunov import entries
from barbalat.certificates.quantities import EACH_INPUT
from barbalat.certificates.requested_keys import is_needed
from barbalat.certificates.rows import up
from barbalat.certificates.step_limits.oscillator import largest_step
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation

NONE_KNOWN = "no proof is known for this controller"
WHOLE_LOOP = "the whole loop, including the plant"
MANY_RESTS = "the loop has many equilibria, and this margin differs between them"


def certificate(problem: TrackingProblem, controller: Controller, simulation: Simulation) -> Certificate:
    """Margins and the step limit by exact linearisation."""
    draft = Draft(own=entries.OWN)
    handed = entries.handed_in(problem, controller)
    if handed is None:
        draft.note(f"no proof is known for {type(controller).__name__}: the following is computed only from its equations")
        draft.missing("error_bound", NONE_KNOWN, theorem=theorems.UNKNOWN_LAW)
    else:
        entries.add_bounds(draft, problem, handed)
    add_linearised(draft, problem, controller, simulation)
    return draft.finish()


def add_linearised(
    draft: Draft, problem: TrackingProblem, controller: Controller, simulation: Simulation, *, bent: str = ""
) -> None:
    """Add the values that follow from the equations alone: margins, and the largest step for the modes.

    ``bent`` says why the law is not differentiable at the equilibrium.
    """
    loop = ClosedLoop.of(problem, controller)
    moving = rest_of(problem, loop, frozen=False)
    still = rest_of(problem, loop, frozen=True) if isinstance(moving, NotApplicable) and loop.parameters else moving
    _add_margins(draft, problem, loop, moving, still, bent)
    _add_step(draft, simulation, moving)


def add_step_of_modes(draft: Draft, problem: TrackingProblem, controller: Controller, simulation: Simulation) -> None:
    """Add the largest step for the modes of the loop or, if the draft already has a limit for a part of the loop, the smaller of
    the two."""
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
            f"step_max is that of the loop linearised {_at(moving)}, by exact Jacobians, without the delay and limits; "
            "it is an estimate for the loop in motion"
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
    """Add margins with frozen estimates and with the law, for a scheme without a formula for these loops."""
    if is_needed(*KEYS_OF_MARGINS.values(), *EACH_INPUT.values(), "sensitivity_peak", "complementary_sensitivity_peak"):
        loop = ClosedLoop.of(problem, controller)
        _add_frozen(draft, problem, loop, rest_of(problem, loop, frozen=True))
    add_adapting(draft, problem, controller, none=none)


def add_adapting(draft: Draft, problem: TrackingProblem, controller: Controller, *, none: str = "") -> None:
    """Add the delay margin with the law, for one input; ``none`` is the reason if the scheme has no law."""
    loop = ClosedLoop.of(problem, controller)
    if not is_needed("delay_margin_adapting") or loop.inputs > 1 or not loop.parameters:
        return
    if none:
        draft.missing("delay_margin_adapting", none)
        return
    with draft.part("delay_margin_adapting"):
        _add_adapting(draft, problem, rest_of(problem, loop, frozen=False))


def _add_frozen(draft: Draft, problem: TrackingProblem, loop: ClosedLoop, still: Rest | NotApplicable) -> bool:
    """Add the margins with frozen estimates; return whether the loop has an equilibrium."""
    if isinstance(still, NotApplicable):
        draft.missing("delay_margin", still.why)
        return False
    which = f"{'with its estimates frozen, ' if loop.parameters else ''}linearised {_at(still)}{still.place}"
    if loop.inputs > 1:
        draft.missing(
            "delay_margin",
            "the margin for a common delay in all inputs is not known; delay_margin_each is for each input separately",
        )
        add_margins_of_each(draft, problem, [still.broken_at(i, frozen=True) for i in range(loop.inputs)], which, still.found)
    else:
        add_margins(draft, problem, still.broken(frozen=True), which, rest=still.found)
    return True


def _at(rest: Rest) -> str:
    values = ", ".join(f"{value:g}" for value in rest.level)
    return f"at the constant command {values}" if rest.level.any() else "at rest"


def column(problem: TrackingProblem, controller: Controller, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The class's name, and cells that state only computed results."""
    estimates = ClosedLoop.of(problem, controller).parameters
    unknown = {key: nothing(key, NONE_KNOWN) for key in ("stability", "tracking", "transient", "estimates", "modelling_error")}
    return type(controller).__name__, {
        **unknown,
        **_of_its_V(certificate),
        **({} if estimates else {"estimates": advice("estimates", "it estimates nothing")}),
        "tuning": estimate("tuning", limits_text(certificate)),
        "margins": margins_cell(certificate),
    }


def _of_its_V(certificate: Certificate) -> dict[str, Entry]:
    """The cells that follow from a V supplied by the law's author."""
    found = {key: certificate.entry(key) for key in ("lyapunov_decay", "error_bound", "estimates_error_bound", "error_limit")}
    decay, bound, of_estimates, limit = found.values()
    cells = {}
    if decay is not None and bound is not None:
        cells["stability"] = statement("stability", f"every quantity in V stays bounded: {decay.value}", *decay.rests_on)
        cells["transient"] = statement("transient", f"every |e_i| <= {up(bound.value)}", *bound.rests_on)
    if of_estimates is not None:
        cells["estimates"] = statement("estimates", f"every |theta_tilde_i| <= {up(of_estimates.value)}", *of_estimates.rests_on)
    if limit is not None:
        cells["tracking"] = statement("tracking", "e goes to zero", *limit.rests_on)
    return cells
