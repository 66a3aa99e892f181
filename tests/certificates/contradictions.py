"""Find guarantees of a certificate that a run violates, and statements that it makes although nothing applies."""

from __future__ import annotations

import re

import numpy as np
from mixtures import SIMULATION

from adaptation.examples import example_of
from barbalat import KnownParameters
from barbalat.certificates.bounds.formulas import steepest_seen
from barbalat.certificates.cells import Column
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.certificates import table_1
from barbalat.certificates.certify import certify
from barbalat.controllers.parametric_model import OnParametricModel
from barbalat.problem.known_set import Gain
from barbalat.roles import THETA
from barbalat.run.results.result import Result

OF_THE_LOOP = ("stability", "tracking", "transient")
"""The rows of Table 1 that must not claim anything with a delay or a limit."""
CLAIMS = re.compile(
    r"(?<!for )\|(e|y|y - y_m)\| <=|converges to zero for|for every bounded r|for every Gamma|to zero for a constant r"
)
"""Phrases by which these rows claim something."""
ROUNDING = 1 + 1e-6
"""Growth of a nonincreasing quantity due to RK4's error at these steps."""
RUNAWAY_FACTOR = 5.0
"""Factor by which the error in the last quarter exceeds all earlier errors if a loop diverges. The rate is then above 0.3/s."""


SOLVED = 1e-6
"""Solver's error, relative to the model's motion, that is allowed where e is zero."""


def judged(problem, controller, simulation=SIMULATION) -> tuple[Certificate, Column]:
    certificates = certify(problem, [controller], simulation)
    return certificates[controller.name], table_1(problem, [controller], certificates).columns[0]


def at_stake(certificate: Certificate, column: Column) -> bool:
    """Whether anything is guaranteed that a run could contradict."""
    rows = {key for key, cell in column.cells.items() if cell.kind == "guaranteed"}
    return bool(
        rows & {*OF_THE_LOOP, "estimates"} or certificate.guaranteed & {"error_bound", "error_bound_worst", "output_bound"}
    )


def exceeded(certificate: Certificate, column: Column, run: Result) -> list[str]:
    """The guarantees that a run violates."""
    claimed = {key: certificate.values[key] for key in certificate.guaranteed}
    rows = {key for key, cell in column.cells.items() if cell.kind == "guaranteed"}
    seen = {"stability": runs_away(run), "tracking": runs_away(run)}
    seen["estimates"] = "estimates" in rows and estimates_grow(run, column.cells["estimates"].text)
    found = [row for row, false in seen.items() if row in rows and false]
    no_error = "transient" in rows and "e is zero" in column.cells["transient"].text
    if no_error and isinstance(run.controller, KnownParameters) and not largest_error(run) <= SOLVED:
        found.append("transient")
    e = np.inf if run.diverged_at is not None else max(run.figures["max_abs_e"])
    bounds = ("error_bound", "error_bound_worst", "error_bound_command")
    found += [key for key in bounds if key in claimed and not e <= claimed[key]]
    if "bounds" in claimed:
        largest = {"r": np.abs(run.r).max(initial=0.0), "x_m": np.abs(run.x_m).max(initial=0.0)}
        found += [f"bound of {name}" for name, value in claimed["bounds"].items() if not largest[name] <= value]
    if "output_bound" in claimed:
        y = np.abs([run.problem.dynamics.output(x) for x in run.x]).max()
        f = run.problem.plant.f
        found += ["output_bound"] if run.diverged_at is not None or not y <= claimed["output_bound"] else []
        found += ["slope"] if f is not None and not steepest_seen(f, y) <= claimed["slope"] else []
    if "W_hat_bound" in claimed and run.diverged_at is None and run.label is None:
        seen_of = {
            "W_hat_bound": np.abs(run.theta_hat).max(),
            "V_hat_bound": np.linalg.norm(run.reported["V_hat"], axis=1).max(),
            "control_bound": run.figures["max_abs_u"] if "control_bound" in claimed else 0.0,
        }
        found += [key for key, value in seen_of.items() if key in claimed and not np.max(value) <= claimed[key] * ROUNDING]
    if "sigma_needed" in claimed and not np.abs(run.theta_hat).max() <= claimed["sigma_needed"]:
        found.append("sigma_needed")
    return found


def largest_error(run: Result) -> float:
    """The largest error relative to the largest |x_m|."""
    return np.inf if run.diverged_at is not None else max(run.figures["max_abs_e"]) / max(np.abs(run.x_m).max(), 1e-9)


def runs_away(run: Result) -> bool:
    """Whether the run diverged or the error in its last quarter is far above all earlier errors."""
    if run.diverged_at is not None:
        return True
    largest = np.maximum(np.abs(run.envelope.e_min), np.abs(run.envelope.e_max)).max(axis=1)
    last = len(largest) * 3 // 4
    return bool(largest[last:].max() > RUNAWAY_FACTOR * largest[:last].max() + 1e-9)


def estimates_grow(run: Result, text: str) -> bool:
    """Whether theta_tilde'Gamma^-1 theta_tilde, or the same with P for Gamma, exceeds V(0) although the cell excludes it for a
    continuous law."""
    scheme, equations = run.controller, run.loop.continuous
    if run.loop.sample_time is not None or "pulled" in text or run.diverged_at is not None or run.problem.feedback == "output":
        return False
    if run.loop.estimates is not None and run.loop.estimates.role.of != THETA:
        return gains_grow(run)
    theta_tilde = run.theta_hat - run.problem.parameters
    n = theta_tilde.shape[1]
    if isinstance(equations, OnParametricModel):
        law, gain_of_V = scheme.law, example_of(scheme.law).gain_of_V
        metrics = [gain_of_V(law, run.loop.unpack(state).controller.memory, n) for state in run.states]
    else:
        metrics = [Gain(scheme.gamma).as_matrix(n)] * len(theta_tilde)
    V = [error @ np.linalg.solve(metric, error) for error, metric in zip(theta_tilde, metrics, strict=True)]
    return bool(max(V) > V[0] * ROUNDING + 1e-12)


def gains_grow(run: Result) -> bool:
    """Whether V grows for a scheme that estimates both gains: V contains the sum of k_x_tilde'Gamma^-1 k_x_tilde +
    k_r_tilde^2/gamma_r of each input, times its omega."""
    plant, scheme = run.problem.plant, run.controller
    omega, k_0 = np.array([path.gain for path in plant.paths]), np.array(run.problem.reference_model.k_0, dtype=float).reshape(-1)
    if run.true_values is None:
        return False  # the true weights are not known; their bounds are checked above
    of_x, of_r = np.tile(omega, len(plant.theta) // len(omega)), np.repeat(omega, len(k_0) // len(omega))
    k_x, k_r = run.theta_hat - plant.theta / of_x, run.reported["k_r_hat"] - k_0 / of_r
    inverse = np.linalg.inv(Gain(scheme.gamma).as_matrix(k_x.shape[1])) * of_x
    V = np.einsum("ki,ij,kj->k", k_x, inverse, k_x) + k_r**2 @ of_r / (scheme.gamma_r or scheme.gamma)
    return bool(V.max() > V[0] * ROUNDING + 1e-12)


def claims_where_nothing_holds(certificate: Certificate, column: Column) -> list[str]:
    """Rows that do not apply but still state something, and bounds that do not apply but have a flat key."""
    document = column.as_json()
    found = [
        key
        for key in OF_THE_LOOP
        if not column.cells[key].applies and (document[key]["value"] is not None or CLAIMS.search(document[key]["text"]))
    ]
    flat = certificate.as_json()
    return found + [entry.key for entry in certificate.entries if not entry.applies and entry.key in flat]
