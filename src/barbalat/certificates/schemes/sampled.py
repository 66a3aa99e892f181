"""How sampling changes the certificate of a continuous controller, and the limits on a law that takes Euler steps.

Margins of the continuous loop don't apply to the sampled one. The sampled-data loop of a linear time-invariant controller is
linear and time-invariant. For any other controller, the loop is linearised in sampled-data form at its equilibrium, with frozen
estimates and with its law.
"""

from __future__ import annotations

import math
from dataclasses import replace

from barbalat.certificates.assumptions import ACTS_CONTINUOUSLY
from barbalat.certificates.cells import nothing, on_damping, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Entry
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.from_sample_to_sample import linearised
from barbalat.certificates.linear_loops.margin_values import KEYS_OF_MARGINS
from barbalat.certificates.linear_loops.over_ranges import MARGINS_KEY
from barbalat.certificates.quantities import EACH_INPUT
from barbalat.certificates.requested_keys import leaving_out
from barbalat.certificates.rows import radius_text
from barbalat.certificates.schemes import HeldFile, LinearFile, bounded_response, sampled_margins, scheme_file, unregistered
from barbalat.certificates.schemes.bounded_response import OF_RESPONSES
from barbalat.certificates.schemes.midpoint import MidpointFile
from barbalat.certificates.schemes.sampled_loop import OF_SAMPLED_LOOPS, add_loop
from barbalat.certificates.theorems import joined, of_linear_loop
from barbalat.controllers import Sampled
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.solvers import EULER
from barbalat.solvers.simulation import Simulation

NO_MIDPOINT_LIMITS = "its law is numerically stable at every gain, so there is no gamma_max and no step_max"
EULER_LIMITS = "gamma_max and step_max are those of Euler's method at the sample time, for all integrators of the controller"
WHOLE_LOOP_LIMITS = (
    "step_max is that of Euler's method "
    "on the whole loop including the plant; with a sampled controller the plant is integrated exactly, so the largest possible "
    "sample time may be longer or shorter"
)
HELD_LIMITS = "gamma_max and step_max are those of the frozen law in sampled-data form, with A_m's exact motion between samples"
LIMIT_KEYS_AT_MODEL = {"gamma_max_at_model", "step_max_at_model"}
"""Keys that belong to the continuous law; a sampled law has separate values where they are known."""
ERROR_BOUND_KEYS = {"error_bound", "error_bound_worst", "error_bound_command"}
OF_THE_CONTINUOUS_LOOP = frozenset(
    {
        *KEYS_OF_MARGINS.values(),
        *EACH_INPUT.values(),
        *over_known_set.MU_KEYS,
        MARGINS_KEY,
        "delay_margin_adapting",
        "state_bound",
    }
)
"""Keys of the closed loop, which a sampled loop has of its own."""
LIMIT_KEYS = {"gamma_max", "step_max"}


def judged_at(controller: Sampled, simulation: Simulation) -> Simulation:
    """The simulation whose step limits the controller; for a law that takes Euler steps, its step is the sample time."""
    if controller.discretization != "euler":
        return simulation
    T = controller.sample_time
    return Simulation(t_end=T * math.ceil(simulation.t_end / T * (1 - 1e-9)), dt=T, solver=EULER)


def certificate(problem: TrackingProblem, controller: Sampled, simulation: Simulation) -> Certificate:
    """The certificate of the sampled controller, derived from that of the continuous controller at ``judged_at`` and from the
    linear loops of the sampled controller."""
    controller.bind(problem.known)  # rejects controllers without a sampled form
    scheme, T, judged = controller.controller, controller.sample_time, judged_at(controller, simulation)
    file = scheme_file(scheme)
    own_states = problem.fixed is not None and problem.fixed.order > 0  # the linear bounds don't cover sampling of these states
    linear = file.linear_when(problem, scheme) if isinstance(file, LinearFile) and not own_states else None
    with leaving_out(*OF_THE_CONTINUOUS_LOOP):
        continuous = (file or unregistered).certificate(problem, scheme, judged)
    dropped = LIMIT_KEYS_AT_MODEL | OF_THE_CONTINUOUS_LOOP | {"margins_of", "unlimited"}
    if linear:  # their small-gain argument belongs to the continuous loop
        dropped |= {"norms", "condition"}
    entries = [_sampled(entry, controller) for entry in continuous.entries if entry.key not in dropped]
    if linear:
        entries = [replace(entry, theorem=of_linear_loop(entry.theorem)) for entry in entries]
    notes = [f"the controller runs sampled every {T:g} s ({controller.discretization})"]
    continuous = replace(continuous, loops=())
    if linear:
        return _of_linear(problem, controller, continuous.with_entries(tuple(entries), *notes), linear, simulation.t_end)
    if controller.discretization == "midpoint":
        entries = [entry for entry in entries if entry.key not in LIMIT_KEYS]
        if ClosedLoop.of(problem, scheme).parameters > 0:
            notes.append(NO_MIDPOINT_LIMITS)
        if isinstance(file, MidpointFile):
            notes.extend(file.midpoint_form(problem, scheme, T).findings)
        draft = Draft({entry.key: entry for entry in entries}, notes, own=OF_SAMPLED_LOOPS | OF_RESPONSES)
        sampled_margins.add(draft, problem, controller, simulation.t_end)
        return continuous.with_entries(tuple(draft.entries.values()), *draft.notes)
    draft = Draft({entry.key: entry for entry in entries}, notes, own=OF_SAMPLED_LOOPS | OF_RESPONSES)
    if isinstance(file, HeldFile):
        draft.estimate(file.held_limits(problem, scheme, judged, draft["nu_0"]), HELD_LIMITS)
    limits = {key: draft[key] for key in ("gamma_max", "step_max") if draft.get(key) is not None}
    step = continuous.entry("step_max")
    whole_loop = step is not None and bool(step.of)
    if not isinstance(file, HeldFile):
        draft.estimate(limits, WHOLE_LOOP_LIMITS if whole_loop else EULER_LIMITS)
    sampled_margins.add(draft, problem, controller, simulation.t_end)
    step_max = limits.get("step_max")
    if step_max is not None and step_max < T:
        unstable = _unstable(step_max, whole_loop, draft.get("spectral_radius_adapting"))
        for key in ERROR_BOUND_KEYS & draft.entries.keys():
            draft.entries[key] = replace(draft.entries[key], why=f"{draft.entries[key].why}; {unstable}")
        draft.note(unstable)
    return on_damping(continuous.with_entries(tuple(draft.entries.values()), *draft.notes))


def _of_linear(problem: TrackingProblem, controller: Sampled, continuous: Certificate, linear: str, t_end: float) -> Certificate:
    """The certificate with the stability and margins of the sampled loop; the step of a solver or law is then irrelevant."""
    left = {entry.key: entry for entry in continuous.entries if entry.key not in LIMIT_KEYS}
    draft, found = Draft(left, list(continuous.notes), own=OF_SAMPLED_LOOPS | OF_RESPONSES), linearised(problem, controller)
    bounded_response.add(draft, problem, controller, t_end)
    if add_loop(draft, problem, found, linear) and isinstance(problem, Problem) and problem.plant.inputs == 1:
        over_known_set.add_sampled(draft, problem, found)
    return draft.finish()


def _unstable(step_max: float, whole_loop: bool, radius: float | None) -> str:
    """A sentence on what may be unstable (for most schemes only their states, for others also the plant) and on what is known
    about the actual loop."""
    at_rest = ""
    if radius is not None:
        verdict = "stable" if radius < 1 else "unstable"
        loop = "with its law linearised at the largest command, the sampled loop"
        at_rest = f"; {loop} is {verdict} with spectral radius {radius_text(radius)}"
    if not whole_loop:
        return f"with |x| at its bound the law admits sample times only up to {step_max:.3g} s{at_rest}"
    return (
        f"on the whole loop including the plant, at its equilibrium, Euler's method is stable up to steps of about "
        f"{step_max:.3g} s; the sampled controller, with exact motion of the plant, may be unstable{at_rest}"
    )


def _sampled(entry: Entry, controller: Sampled) -> Entry:
    """The part of an entry for a continuous controller that remains valid for a controller that acts only at samples."""
    if entry.kind == "guaranteed" and not entry.quantity.timeless:
        return _at_samples(entry, f"sampled every {controller.sample_time:g} s")
    if any(one.sentence == ACTS_CONTINUOUSLY.sentence for one in entry.rests_on) and not entry.applies:
        why = f"sampled every {controller.sample_time:g} s"
        return replace(_at_samples(entry, why), why=f"{entry.why}, {why}")
    return entry


def _at_samples(entry: Entry, why: str) -> Entry:
    return replace(
        entry,
        kind="does not apply",
        why=why,
        theorem=joined([entry.theorem, ACTS_CONTINUOUSLY.theorem]),
        rests_on=(*entry.rests_on, replace(ACTS_CONTINUOUSLY, broken=why)),
    )


def column(problem: TrackingProblem, controller: Sampled, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The column of a sampled controller; it keeps only those claims of the continuous controller that the midpoint rule
    preserves."""
    name, continuous = (scheme_file(controller.controller) or unregistered).column(problem, controller.controller, certificate)
    why = f"sampled every {controller.sample_time:g} s"
    cells = {
        key: replace(_at_samples(cell, why), value=None) if cell.kind == "guaranteed" else cell
        for key, cell in continuous.items()
    }
    adapting, frozen = (certificate.entry(key) for key in ("spectral_radius_adapting", "spectral_radius"))
    radius = adapting or frozen
    if radius is not None and radius.applies:
        verdict = "stable" if radius.value < 1 else "unstable"
        at = "at the case's theta"
        if adapting is not None:
            at = "with its law linearised at the largest command"
        elif radius.rest is not None and radius.rest.estimates:
            at = "with its estimates frozen"
        about = f"{why}; the sampled-data loop {at} is {verdict} with spectral radius {radius_text(radius.value)}"
        cells["stability"] = nothing("stability", about)
    cells |= bounded_response.cells(certificate)
    if controller.discretization == "midpoint":
        cells["estimates"] = _estimates(problem, continuous["estimates"], controller, cells["estimates"])
    return f"{name}, sampled ({controller.discretization})", cells


def _estimates(problem: TrackingProblem, continuous: Entry, controller: Sampled, otherwise: Entry) -> Entry:
    """V of the sampled law, under the assumptions of the continuous law (see docs/sampled.md)."""
    file = scheme_file(controller.controller)
    if not isinstance(file, MidpointFile):
        return otherwise
    form = file.midpoint_form(problem, controller.controller, controller.sample_time)
    rests_on = form.rests_on
    if continuous.kind == "guaranteed":
        rests_on = continuous.rests_on
    if rests_on is None:
        return otherwise
    more = "" if form.kept else ", and the leakage w at most T w |theta|^2/2"
    only = "only the plant's motion between samples, where it deviates from the midpoint rule, adds to V"
    text = f"the law's V does not grow at any gain and sample time; {only}{more}"
    return statement("estimates", text, *(each for each in rests_on if each != ACTS_CONTINUOUSLY), form.never_cut)
