"""What sampling takes away from a continuous controller's certificate, and the limits of a law that takes Euler steps."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from barbalat.adaptation.law import SampledLaw
from barbalat.certificates.assumptions import ACTS_CONTINUOUSLY, CONTINUOUS_ONLY, OF_THE_PROBLEM
from barbalat.certificates.bounds.model import model_bounds
from barbalat.certificates.cells import Column, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption, Entry
from barbalat.certificates.schemes import scheme_file
from barbalat.certificates.schemes.state_feedback import of_the_case
from barbalat.certificates.step_limits import any_regressor, frozen_laws
from barbalat.certificates.step_limits.held_oscillator import HeldOscillator
from barbalat.controllers import L1Adaptive, LinearFeedback, Mrac, NormalizedMrac, RobustMrac, Sampled
from barbalat.controllers.output.mrac import MracOutput
from barbalat.problem.known_set import EstimateSet, Gain
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.solvers import EULER
from barbalat.solvers.simulation import Simulation

MIDPOINT = "no gain makes its law numerically unstable, so there is no gamma_max and no step_max"
AS_EULER = "gamma_max and step_max are those of Euler's method at the sample time, for all that the controller integrates"
HELD = "gamma_max and step_max are of the frozen law from sample to sample, with A_m's exact motion between them"
AT_MODEL = {"gamma_max_at_model", "step_max_at_model"}
"""Limits that are not known of a sampled law."""
ERRORS = {"error_bound", "error_bound_worst"}
SAMPLING_CHANGES_NOTHING = OF_THE_PROBLEM | {"norms", "condition", "kappa_admissible", "kappa_max", "nu_0", "nu_0_worst"}
"""Guaranteed values that are of the problem, of the filter, or of t = 0."""


def judged_at(controller: Sampled, simulation: Simulation) -> Simulation:
    """The simulation whose numerics limit the controller: for a law that takes Euler steps, these steps."""
    if controller.discretization != "euler":
        return simulation
    T = controller.sample_time
    return Simulation(t_end=T * math.ceil(simulation.t_end / T * (1 - 1e-9)), dt=T, solver=EULER)


def certificate(problem: TrackingProblem, continuous: Certificate, controller: Sampled, judged: Simulation) -> Certificate:
    """From the continuous controller's certificate at ``judged_at``."""
    scheme, T = controller.controller, controller.sample_time
    entries = [_sampled(entry, controller) for entry in continuous.entries if entry.key not in AT_MODEL]
    notes = [f"the controller runs sampled every {T:g} s ({controller.discretization})"]
    if isinstance(scheme, LinearFeedback):
        return continuous.with_entries(tuple(entries), *notes)
    if controller.discretization == "midpoint":
        entries = [entry for entry in entries if entry.key not in ("gamma_max", "step_max")]
        return continuous.with_entries(tuple(entries), *notes, MIDPOINT, *_of_the_midpoint_form(controller))
    draft = Draft({entry.key: entry for entry in entries}, notes)
    if isinstance(scheme, Mrac):  # all that it integrates is the law
        draft.estimate(_of_mrac(problem, scheme, judged, draft["nu_0"]), HELD)
    limits = {key: draft[key] for key in ("gamma_max", "step_max") if draft.get(key) is not None}
    if not isinstance(scheme, Mrac):
        draft.estimate(limits, AS_EULER)
    step_max = limits.get("step_max")
    if step_max is not None and step_max < T:
        where = "where it rests the loop" if scheme_file(scheme) is None else "where |x| is as large as its bound the law"
        unstable = f"{where} is numerically unstable: it bears samples up to about {step_max:.3g} s"
        for key in ERRORS & draft.entries.keys():
            draft.entries[key] = replace(draft.entries[key], why=f"{draft.entries[key].why}; {unstable}")
        draft.note(unstable)
    return continuous.with_entries(tuple(draft.entries.values()), *draft.notes)


def _sampled(entry: Entry, controller: Sampled) -> Entry:
    """What is left of a continuous controller's value when the controller acts at samples only."""
    if entry.kind == "guaranteed" and entry.key not in SAMPLING_CHANGES_NOTHING:
        return replace(entry, kind="does not apply", why=f"sampled every {controller.sample_time:g} s")
    if entry.kind == "exact":
        return replace(entry, kind="estimate", assumptions=(*entry.assumptions, CONTINUOUS_ONLY))
    return entry


def _of_mrac(problem: TrackingProblem, scheme: Mrac, judged: Simulation, nu_0: float) -> dict[str, Any]:
    """gamma_max and step_max; |x| within the bounds of the model and of e."""
    assert isinstance(problem, Problem)
    held, known = HeldOscillator(problem.known), problem.known
    if known.inputs > 1 or not problem.plant.is_linear or problem.input_gain is not None:
        return any_regressor.of_lyapunov_law(problem, scheme, judged, nu_0, held)
    reach = model_bounds(problem).x_m_euclidean
    values = frozen_laws.of_lyapunov_law(problem, scheme.gamma, judged, reach, nu_0, oscillator=held)
    return frozen_laws.with_modifications(values, scheme, judged)


def _of_the_midpoint_form(controller: Sampled) -> list[str]:
    """What docs/sampled.md derives of the MRAC's, which has no filter between fast estimates and the input."""
    scheme, T = controller.controller, controller.sample_time
    if not isinstance(scheme, (Mrac, L1Adaptive)):
        return []
    findings = []
    if isinstance(scheme, Mrac) or scheme.filter is None:
        findings.append(
            f"for a high gain and short samples its loop inside the known set bears a delay of one sample, {T:g} s, at the "
            "plant's input; beyond that the estimates run between their bounds, and no bound of e is proven"
        )
    if np.ndim(scheme.gamma) == 2 or scheme.learning is not None:
        findings.append(
            "with a gain matrix or learning the predictor is fed with the estimate before its projection: while the projection "
            "acts, x_hat leaves x_m, and with a delay the loop may be lost"
        )
    return findings


def column(problem: TrackingProblem, column: Column, controller: Sampled) -> Column:
    """What holds in continuous time is not claimed of a sampled controller, but what the midpoint rule keeps of V is."""
    why = f"sampled every {controller.sample_time:g} s"
    cells = {
        key: replace(cell, value=None, kind="does not apply", why=why) if cell.kind == "guaranteed" else cell
        for key, cell in column.cells.items()
    }
    if controller.discretization == "midpoint":
        cells["estimates"] = _estimates(problem, column.cells["estimates"], controller, cells["estimates"])
    return replace(column, scheme=f"{column.scheme}, sampled ({controller.discretization})", cells=cells)


def _estimates(problem: TrackingProblem, continuous: Entry, controller: Sampled, otherwise: Entry) -> Entry:
    """V of the law from sample to sample, under the assumptions of the continuous law; see docs/sampled.md."""
    scheme: Any = controller.controller
    leakage = getattr(getattr(scheme, "law", scheme), "leakage", None)
    held = leakage is None or leakage.harmless_within is not None
    more = "" if held else ", and the leakage w no more than T w |theta|^2/2"
    only = "only the plant's motion between samples, off the midpoint rule, adds to it"
    text = f"no gain and no sample time make V of the law grow; {only}{more}"
    if continuous.kind == "guaranteed":
        rests_on = tuple(Assumption(sentence) for sentence in continuous.assumptions)
    elif isinstance(problem, Problem) and isinstance(scheme, (Mrac, L1Adaptive)) and not held:
        rests_on = of_the_case(problem, scheme.bind(problem.known).box)
    else:
        return otherwise
    kept = (each for each in rests_on if each != ACTS_CONTINUOUSLY)
    return statement("estimates", text, *kept, _no_corner_cut(scheme, scheme.bind(problem.known).box))


def _no_corner_cut(scheme: Any, box: EstimateSet | None) -> Assumption:
    """What lies outside after a step with a coupling gain is brought back face by face, which is exact for two of them."""
    law = scheme.law if isinstance(scheme, (NormalizedMrac, RobustMrac, MracOutput)) else None
    metric = law.metric if isinstance(law, SampledLaw) else Gain(scheme.gamma)
    cut = metric.is_matrix and box is not None and box.steps_cut_corners
    return Assumption("a step never cuts a corner", "a gain matrix in corners of the known set" if cut else "")
