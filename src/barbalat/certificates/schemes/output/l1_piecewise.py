"""The certificate of L1 output feedback with the piecewise-constant law: a linear sampled controller whose loop is known exactly.

For T -> 0 the law keeps c'x_hat = y, so u = C/((1 - C) M) [M r - y] for every g: ``linear_equivalent_limit``, as for the scheme
with a first-order model. For T > 0 the controller has no pole at z = 1, and a small part of a constant disturbance remains.

On a plant that equals the model, under a constant sigma at equilibrium, x~ = Phi x~ + Gamma (sigma_hat - sigma), sigma_hat = -G
c'x~ and Gamma G = Phi g: with q = c'(I - Phi)^-1 Phi g and the effect of sigma on y, s = c'(I - Phi)^-1 Gamma sigma, this gives
sigma_hat = G s/(1 + q), of rank one, whose effect on y is s q/(1 + q). The fraction 1/(1 + q) remains, which is 1 - e^(a T) for a
first-order model.

``error_bound`` bounds e = y - y_m for every r and d no larger than those of the case.

Plant, controller and the model under the sampled command are one linear sampled-data system, so the largest effect of r on e at
the samples is the sum of its impulse response. The disturbance d acts all the time. In a sample its effect on a row c is at most
|d| integral_0^T |c e^(A s) B| ds. Within a part of the sample e^(A s) B differs from its value at the start of the part s_j by at
most |e^(A s_j)| (e^(|A| T/P) - I) |B|. Between samples, a motion under a held input differs from the straight line by at most
T^2/8 times its second derivative, as in ``piecewise_reference``. The motion of the model between samples under the continuous r
is covered by ``missed``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from barbalat.certificates import theorems
from barbalat.certificates.assumptions import bounded_command, exact_plant, measured
from barbalat.certificates.cells import advice, estimate, margins_cell, nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption, Entry, NotApplicable
from barbalat.certificates.linear_loops.from_sample_to_sample import Linearised, linearised
from barbalat.certificates.linear_loops.margin_values import margins_of
from barbalat.certificates.linear_loops.sampled_response import missed
from barbalat.certificates.quantities import Form, Quantity
from barbalat.certificates.rows import up
from barbalat.certificates.schemes.output_feedback import LINEAR_LOOP, OF_LINEAR_LOOPS, START_AT_REST
from barbalat.certificates.schemes.sampled_loop import OF_SAMPLED_LOOPS, add_loop, add_noise, unstable
from barbalat.controllers.output.l1_piecewise import Equations, L1OutputPiecewiseConstant
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.linear.sampled_norms import SampledNorms, grown
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.problem.output_feedback import OutputProblem
from barbalat.protocols import BoundedSignal
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

PARTS = 16
"""Number of parts of a sample, in each of which d is bounded; for a slow plant, more parts do not change the displayed digits."""


class ErrorBound(NamedTuple):
    """Bounds on |e| at all times, with respect to the model driven by the sampled command and to the model driven by r."""

    held: float
    error: float | NotApplicable


class _Loop(NamedTuple):
    """z[k+1] = M z[k] + N r[k], u = K z + L r, with z = (plant, predictor, filter, model); ``first`` times the first r is the
    initial state."""

    M: Array
    N: Array
    K: Array
    L: Array
    first: Array
    plant: StateSpace
    model: StateSpace


def error_bound(problem: OutputProblem, equations: Equations, t_end: float) -> ErrorBound | NotApplicable:
    """The bound; raises InputError if the sampled-data loop is unstable, or decays too slowly for a bound."""
    r, d = problem.reference, problem.disturbance
    if not isinstance(r, BoundedSignal) or not (d is None or isinstance(d, BoundedSignal)):
        return NotApplicable("r or d has no known bound")
    held = _held(_loop(problem, equations), equations.sample_time, r.bound, 0.0 if d is None else d.bound)
    model = problem.known.W_m.realise()
    beside = missed(model.A, model.B[:, None], model.C[None], r, equations.sample_time, t_end)
    if isinstance(beside, NotApplicable):
        return ErrorBound(held, beside)
    return ErrorBound(held, (held + beside) * OUTWARD_FACTOR)


def _held(loop: _Loop, T: float, r: float, d: float) -> float:
    plant, model, size = loop.plant, loop.model, len(loop.M)
    p, m = plant.order, model.order
    starts = [HeldSystem.of(plant.A, plant.B, j * T / PARTS).Phi for j in range(PARTS)]
    off = (grown(plant.A, T / PARTS) - np.eye(p)) @ np.abs(plant.B)
    reached = np.hstack([np.column_stack([start @ plant.B, start]) for start in starts])  # times before the end of a sample
    weights = T / PARTS * np.tile(np.append(1.0, off), PARTS)

    def largest(C: Array, D: Array) -> Array:
        """The largest |C z + D r| at the samples."""
        norms = SampledNorms(loop.M, C)
        driven = norms.summed(loop.N[:, None])[:, 0] + norms.largest(loop.first[:, None])[:, 0] + np.abs(D)
        if d == 0:
            return np.asarray(driven * r)
        of_d = norms.summed(np.vstack([reached, np.zeros((size - p, reached.shape[1]))])) @ weights
        return np.asarray(driven * r + of_d * d)

    difference = np.concatenate([plant.C, np.zeros(size - p - m), -model.C])
    at_samples = largest(difference[None], np.zeros(1))[0]
    bends = plant.A @ (np.hstack([plant.A, np.zeros((p, size - p))]) + np.outer(plant.B, loop.K))
    curved = np.abs(plant.C) @ grown(plant.A, T) @ largest(bends, plant.A @ plant.B * loop.L)
    of_model = model.A @ np.hstack([np.zeros((m, size - m)), model.A])
    curved += np.abs(model.C) @ grown(model.A, T) @ largest(of_model, model.A @ model.B)
    within = (
        np.abs(plant.C @ reached) @ weights * d
    )  # at the end of a sample, this is part of the bound at the samples, not of the straight line
    return float(at_samples + 2 * within + T**2 / 8 * curved) * OUTWARD_FACTOR


def _loop(problem: OutputProblem, equations: Equations) -> _Loop:
    plant, model, T = problem.plant.dynamics.system, problem.known.W_m.realise(), equations.sample_time
    f, G, c = equations.filter, equations.G, equations.c
    p, n, order = plant.order, len(c), len(f.A)
    size = p + n + order + n
    of_y = np.concatenate([plant.C, -c, np.zeros(order + n)])  # y - y_hat
    sigma = np.outer(G, of_y)
    wanted = np.diag(np.append(-1.0, np.ones(n - 1))) @ sigma  # the filter's input, with r added to its first entry
    passed = np.hstack([np.zeros((order, p + n)), np.eye(order), np.zeros((order, n))]) + f.B @ wanted
    K, L = (f.C @ passed + f.D @ wanted)[0], float((f.C @ f.B + f.D)[0, 0])
    held, of_model = HeldSystem.of(plant.A, plant.B, T), HeldSystem.of(model.A, model.B, T)
    Phi, Gamma = equations.model.Phi, equations.model.Gamma
    M, N = np.zeros((size, size)), np.zeros(size)
    M[:p, :p] = held.Phi
    M[:p] += np.outer(held.Gamma, K)
    M[p : p + n, p : p + n] = Phi
    M[p : p + n] += Gamma @ sigma + np.outer(Gamma[:, 0], K)
    M[p + n : -n] = f.A @ passed + f.B @ wanted
    M[-n:, -n:] = of_model.Phi
    N[:p], N[p : p + n], N[-n:] = held.Gamma * L, Gamma[:, 0] * L, of_model.Gamma
    N[p + n : -n] = f.A @ f.B[:, 0] + f.B[:, 0]
    first = np.zeros(size)
    first[p + n : -n] = -f.B[:, 0]  # the filter's first sample is not one of its steps
    return _Loop(M, N, K, L, first, plant, model)


OWN_QUANTITIES = (
    OF_SAMPLED_LOOPS
    | {key: OF_LINEAR_LOOPS[key] for key in ("steady_error",)}
    | {
        "linear_equivalent_limit": Quantity("u = feedforward[r] - feedback[y] for T -> 0", form=Form.TRANSFER_FUNCTIONS),
        "delay_margin_limit": Quantity("delay_margin for T -> 0", "s"),
        "disturbance_left": Quantity("fraction of the effect of a constant sigma on y that sigma_hat does not include"),
        "error_bound_held": Quantity(
            "bound on |y - y_m| at all times, where y_m is the model's output under the sampled command"
        ),
    }
)
FOR_SMALL_T = "for T -> 0"
BOUNDED_D = Assumption("the only disturbance is a bounded d at the input")
UP_TO_THE_END = Assumption("only the jumps of r up to t_end are considered")


def fast_limit(controller: L1OutputPiecewiseConstant, M: TransferFunction) -> tuple[TransferFunction, TransferFunction]:
    """C/(1 - C) and C/((1 - C) M)."""
    N, D = controller.filter.num, controller.filter.den
    den = np.polysub(D, N)
    den[-1] = 0.0  # C(0) = 1: the remaining difference is rounding
    return TransferFunction(N, den), TransferFunction(np.polymul(N, M.den), np.polymul(den, M.num))


def certificate(problem: OutputProblem, controller: L1OutputPiecewiseConstant, simulation: Simulation) -> Certificate:
    """Loop, margins, noise, bounds on e, the steady error for constant r and d, and the continuous controller in the limit T ->
    0."""
    draft, equations = Draft(own=OWN_QUANTITIES), controller.bind(problem.known)
    _add_error_bound(draft, problem, equations, simulation.t_end)
    _add_at_dc(draft, equations)
    found = linearised(problem, controller)
    if add_loop(draft, problem, found, LINEAR_LOOP):
        add_noise(draft, problem, found, _measured(problem, found), LINEAR_LOOP)
        draft.exact({"steady_error": steady_error(problem, equations)}, "without f", LINEAR_LOOP)
    feedforward, feedback = fast_limit(controller, problem.known.W_m)
    shown = {"feedforward": feedforward, "feedback": feedback}
    coefficients = {name: {"num": system.num.tolist(), "den": system.den.tolist()} for name, system in shown.items()}
    draft.exact({"linear_equivalent_limit": coefficients}, FOR_SMALL_T)
    limit = margins_of(problem, (feedback * problem.plant.transfer_function).realise(), FOR_SMALL_T, draft.notes)
    if "delay_margin" in limit:
        draft.exact({"delay_margin_limit": limit["delay_margin"]}, FOR_SMALL_T, LINEAR_LOOP)
    draft.note("this is a linear sampled controller without adaptation, whose only tunable gain is T")
    return draft.finish()


def _add_error_bound(draft: Draft, problem: OutputProblem, equations: Equations, t_end: float) -> None:
    try:
        found = error_bound(problem, equations, t_end)
    except InputError as error:
        found = NotApplicable(str(error))
    if isinstance(found, NotApplicable):
        draft.all_missing(("error_bound", "error_bound_held"), found.why, theorem=theorems.OUTPUT_LOOP)
        return
    rests_on = _of_the_bound(problem)
    if isinstance(found.error, NotApplicable):
        draft.missing("error_bound", found.error.why, theorem=theorems.OUTPUT_LOOP)
    else:
        draft.guarantee("error_bound", found.error, *rests_on, UP_TO_THE_END)
    draft.guarantee("error_bound_held", found.held, *rests_on)


def _of_the_bound(problem: OutputProblem) -> tuple[Assumption, ...]:
    linear, bounded, start = _rests_on(problem)
    acts = "disturbance at the output" if problem.output_disturbance is not None else ""
    return linear, exact_plant(problem), replace(BOUNDED_D, broken=acts), measured(problem), bounded, start


def _add_at_dc(draft: Draft, equations: Equations) -> None:
    """Add values that don't depend on the plant: the estimate of a constant sigma at equilibrium, and the remainder."""
    Phi, Gamma, c, G = equations.model.Phi, equations.model.Gamma, equations.c, equations.G
    at_rest = np.linalg.solve((np.eye(len(c)) - Phi).T, c)  # c'(I - Phi)^-1
    s, q = at_rest @ Gamma, float(at_rest @ Gamma @ G)
    values = {"sigma_hat_at_dc": (np.outer(G, s) / (1 + q)).tolist(), "disturbance_left": 1 / (1 + q)}
    draft.exact(values, "the controller with a plant equal to the model", LINEAR_LOOP)


def _measured(problem: OutputProblem, found: Linearised) -> Array:
    """(s, 1) a state of the plant, or of the sensor, with y = 1; the controller uses only y."""
    direction = np.zeros((len(found.loop.A), 1))
    at, C = found.rows["measured"], problem.plant.dynamics.system.C
    direction[at, 0] = 1.0 if problem.sensor_lag is not None else C / (C @ C)
    return direction


def steady_error(problem: OutputProblem, equations: Equations) -> dict[str, float]:
    """The steady error e = y - y_m for constant r and d, per unit of each, from the equilibrium of the sampled-data loop without
    f."""
    plant, n = problem.plant.transfer_function, len(equations.c)
    # the unknowns are x_hat, sigma_hat, y and u; at equilibrium the filter's output is C(0) w_1 - h'w_um
    filter, Phi, Gamma = equations.filter, equations.model.Phi, equations.model.Gamma
    at_rest = filter.C @ np.linalg.solve(np.eye(len(filter.A)) - filter.A, 2 * filter.B) + filter.D  # (1, n)
    passed = at_rest * np.append(-1.0, np.ones(n - 1))  # from sigma_hat
    rows = np.zeros((2 * n + 2, 2 * n + 2))
    rows[:n, :n], rows[:n, n : 2 * n], rows[:n, -1] = np.eye(n) - Phi, -Gamma, -Gamma[:, 0]
    rows[n : 2 * n, :n], rows[n : 2 * n, n : 2 * n] = np.outer(equations.G, equations.c), np.eye(n)
    rows[n : 2 * n, -2] = -equations.G
    rows[-2, n : 2 * n], rows[-2, -1] = -passed[0], 1.0
    rows[-1, -2], rows[-1, -1] = plant.den[-1], -plant.num[-1]  # den(0) y = num(0) (u + d)
    given = np.zeros((2 * n + 2, 2))
    given[-2, 0], given[-1, 1] = at_rest[0, 0], plant.num[-1]
    of_r, of_d = np.linalg.solve(rows, given)[-2]
    return {"r": float(of_r - problem.known.W_m.dc_gain), "d": float(of_d)}


def _rests_on(problem: OutputProblem) -> tuple[Assumption, ...]:
    path = problem.plant.paths[0]
    acts = [("f(t, y)", problem.plant.f is not None), ("limits at the input", not path.is_linear)]
    linear = Assumption("the loop is linear", " and ".join(word for word, there in acts if there))
    return linear, bounded_command(problem), START_AT_REST


def column(problem: OutputProblem, _: L1OutputPiecewiseConstant, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    values = certificate.values
    radius, left = values["spectral_radius"], values.get("steady_error")
    stability, tracking = nothing("stability", unstable(radius), *_rests_on(problem)), nothing("tracking", unstable(radius))
    if radius < 1:
        text = f"for every bounded r: a linear sampled-data loop with spectral radius {radius:.6g}"
        stability = statement("stability", text, *_rests_on(problem))
    if left is not None:
        why = (
            f"y does not converge to y_m: a constant r leaves an error of {left['r']:.3g} r, and a constant d one of "
            f"{left['d']:.3g} d"
        )
        tracking = nothing("tracking", why)
    bound = certificate.entry("error_bound")
    transient = nothing("transient", "no bound: " + ("" if bound is None else bound.why))
    if bound is not None and bound.applies:
        transient = statement("transient", f"|y - y_m| <= {up(bound.value)}", *_of_the_bound(problem))
    noise = values.get("noise_in_u")
    return "L1 output feedback, piecewise-constant law", {
        "stability": stability,
        "tracking": tracking,
        "transient": transient,
        "estimates": advice("estimates", "it does not estimate parameters: sigma_hat is the input disturbance of the model"),
        "modelling_error": estimate("modelling_error", "see the margins, which are those of a linear controller"),
        "tuning": advice(
            "tuning",
            "no adaptive gain, only C(s) and T" + ("" if noise is None else f"; noise in y is amplified by {noise[0]:.3g} in u"),
        ),
        "margins": margins_cell(certificate),
    }
