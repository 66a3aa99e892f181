"""What sampling takes away from a continuous controller's certificate, and the limits of a law that takes Euler steps."""

from __future__ import annotations

import math
from dataclasses import replace

from barbalat.certificates.assumptions import ACTS_CONTINUOUSLY, CONTINUOUS_ONLY
from barbalat.certificates.cells import on_damping, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Entry
from barbalat.certificates.schemes import HeldFile, scheme_file, stranger
from barbalat.certificates.schemes.midpoint import MidpointFile
from barbalat.controllers import Sampled
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.problem.tracking import TrackingProblem
from barbalat.solvers import EULER
from barbalat.solvers.simulation import Simulation

NO_MIDPOINT_LIMITS = "no gain makes its law numerically unstable, so there is no gamma_max and no step_max"
EULER_LIMITS = "gamma_max and step_max are those of Euler's method at the sample time, for all that the controller integrates"
HELD_LIMITS = "gamma_max and step_max are of the frozen law from sample to sample, with A_m's exact motion between them"
LIMIT_KEYS_AT_MODEL = {"gamma_max_at_model", "step_max_at_model"}
"""Of the continuous law; a sampled one has its own, where they are known."""
ERROR_BOUND_KEYS = {"error_bound", "error_bound_worst"}


def judged_at(controller: Sampled, simulation: Simulation) -> Simulation:
    """The simulation whose numerics limit the controller: for a law that takes Euler steps, these steps."""
    if controller.discretization != "euler":
        return simulation
    T = controller.sample_time
    return Simulation(t_end=T * math.ceil(simulation.t_end / T * (1 - 1e-9)), dt=T, solver=EULER)


def certificate(problem: TrackingProblem, controller: Sampled, simulation: Simulation) -> Certificate:
    """From the continuous controller's certificate at ``judged_at``."""
    controller.bind(problem.known)  # refuses what has no sampled form
    scheme, T, judged = controller.controller, controller.sample_time, judged_at(controller, simulation)
    file = scheme_file(scheme)
    continuous = (file or stranger).certificate(problem, scheme, judged)
    entries = [_sampled(entry, controller) for entry in continuous.entries if entry.key not in LIMIT_KEYS_AT_MODEL]
    notes = [f"the controller runs sampled every {T:g} s ({controller.discretization})"]
    if controller.discretization == "midpoint":
        entries = [entry for entry in entries if entry.key not in ("gamma_max", "step_max")]
        if ClosedLoop.of(problem, scheme).parameters > 0:
            notes.append(NO_MIDPOINT_LIMITS)
        if isinstance(file, MidpointFile):
            notes.extend(file.midpoint_form(problem, scheme, T).findings)
        return continuous.with_entries(tuple(entries), *notes)
    draft = Draft({entry.key: entry for entry in entries}, notes)
    if isinstance(file, HeldFile):
        draft.estimate(file.held_limits(problem, scheme, judged, draft["nu_0"]), HELD_LIMITS)
    limits = {key: draft[key] for key in ("gamma_max", "step_max") if draft.get(key) is not None}
    if not isinstance(file, HeldFile):
        draft.estimate(limits, EULER_LIMITS)
    step_max = limits.get("step_max")
    if step_max is not None and step_max < T:
        where = "where it rests the loop" if file is None else "where |x| is as large as its bound the law"
        unstable = f"{where} is numerically unstable: it bears samples up to about {step_max:.3g} s"
        for key in ERROR_BOUND_KEYS & draft.entries.keys():
            draft.entries[key] = replace(draft.entries[key], why=f"{draft.entries[key].why}; {unstable}")
        draft.note(unstable)
    return on_damping(continuous.with_entries(tuple(draft.entries.values()), *draft.notes))


def _sampled(entry: Entry, controller: Sampled) -> Entry:
    """What is left of a continuous controller's value when the controller acts at samples only."""
    if entry.kind == "guaranteed" and not entry.quantity.timeless:
        return replace(entry, kind="does not apply", why=f"sampled every {controller.sample_time:g} s")
    if entry.kind == "exact":
        return replace(entry, kind="estimate", assumptions=(*entry.assumptions, CONTINUOUS_ONLY), unsampled=True)
    return entry


def column(problem: TrackingProblem, controller: Sampled, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """What holds in continuous time is not claimed of a sampled controller, but what the midpoint rule keeps of V is."""
    name, continuous = (scheme_file(controller.controller) or stranger).column(problem, controller.controller, certificate)
    why = f"sampled every {controller.sample_time:g} s"
    cells = {
        key: replace(cell, value=None, kind="does not apply", why=why) if cell.kind == "guaranteed" else cell
        for key, cell in continuous.items()
    }
    if controller.discretization == "midpoint":
        cells["estimates"] = _estimates(problem, continuous["estimates"], controller, cells["estimates"])
    return f"{name}, sampled ({controller.discretization})", cells


def _estimates(problem: TrackingProblem, continuous: Entry, controller: Sampled, otherwise: Entry) -> Entry:
    """V of the law from sample to sample, under the assumptions of the continuous law; see docs/sampled.md."""
    file = scheme_file(controller.controller)
    if not isinstance(file, MidpointFile):
        return otherwise
    form = file.midpoint_form(problem, controller.controller, controller.sample_time)
    rests_on = form.rests_on
    if continuous.kind == "guaranteed":
        rests_on = continuous.rests_on
    if rests_on is None:
        return otherwise
    more = "" if form.kept else ", and the leakage w no more than T w |theta|^2/2"
    only = "only the plant's motion between samples, off the midpoint rule, adds to it"
    text = f"no gain and no sample time make V of the law grow; {only}{more}"
    return statement("estimates", text, *(each for each in rests_on if each != ACTS_CONTINUOUSLY), form.never_cut)
