"""The certificate of L1 output feedback with the piecewise-constant law: a linear sampled controller, its loop known exactly.

For T -> 0 it holds c'x_hat = y, so that u = C/((1 - C) M) [M r - y] whatever g is: ``linear_equivalent_limit``, as of the
scheme with a first-order model. For T > 0 it has no pole at z = 1: a little of a constant disturbance is left.

On a plant that is the model, under a constant sigma at rest, x~ = Phi x~ + Gamma (sigma_hat - sigma), sigma_hat = -G c'x~ and
Gamma G = Phi g: with q = c'(I - Phi)^-1 Phi g and what sigma does to y, s = c'(I - Phi)^-1 Gamma sigma, it is
sigma_hat = G s/(1 + q), of rank one, which does s q/(1 + q) to y: 1/(1 + q) is left, 1 - e^(a T) for a model of first order.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from barbalat.certificates.assumptions import bounded_command, exact_plant, measured
from barbalat.certificates.bounds.output_piecewise import error_bound
from barbalat.certificates.cells import advice, estimate, margins_cell, nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption, Entry, NotApplicable
from barbalat.certificates.linear_loops.from_sample_to_sample import Linearised, linearised
from barbalat.certificates.linear_loops.margin_values import margins_of
from barbalat.certificates.quantities import Form, Quantity
from barbalat.certificates.rounding import up
from barbalat.certificates.schemes.output_feedback import LINEAR_LOOP, OF_LINEAR_LOOPS, START_AT_REST
from barbalat.certificates.schemes.sampled_loop import OF_SAMPLED_LOOPS, add_loop, add_noise, unstable
from barbalat.controllers.output.l1_piecewise import Equations, L1OutputPiecewiseConstant
from barbalat.linear.systems import TransferFunction
from barbalat.problem.output_feedback import OutputProblem
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

OWN_QUANTITIES = (
    OF_SAMPLED_LOOPS
    | {key: OF_LINEAR_LOOPS[key] for key in ("steady_error",)}
    | {
        "linear_equivalent_limit": Quantity("u = feedforward[r] - feedback[y] for T -> 0", form=Form.TRANSFER_FUNCTIONS),
        "delay_margin_limit": Quantity("delay_margin for T -> 0", "s"),
        "disturbance_left": Quantity("share of what a constant sigma does to y that sigma_hat leaves"),
        "error_bound_held": Quantity("of |y - y_m| at all times, y_m of the model under the command as it is sampled"),
    }
)
FOR_SMALL_T = "for T -> 0"
BOUNDED_D = Assumption("no disturbance acts but a bounded d at the input")
UP_TO_THE_END = Assumption("jumps of r are those up to t_end")


def fast_limit(controller: L1OutputPiecewiseConstant, M: TransferFunction) -> tuple[TransferFunction, TransferFunction]:
    """C/(1 - C) and C/((1 - C) M)."""
    N, D = controller.filter.num, controller.filter.den
    den = np.polysub(D, N)
    den[-1] = 0.0  # C(0) = 1: what is left of the difference is rounding
    return TransferFunction(N, den), TransferFunction(np.polymul(N, M.den), np.polymul(den, M.num))


def certificate(problem: OutputProblem, controller: L1OutputPiecewiseConstant, simulation: Simulation) -> Certificate:
    """Loop, margins, noise, bounds of e, what constant r and d leave, the continuous controller that it tends to."""
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
    draft.note("a linear sampled controller: no gain to tune but T, and nothing is learnt")
    return draft.finish()


def _add_error_bound(draft: Draft, problem: OutputProblem, equations: Equations, t_end: float) -> None:
    try:
        found = error_bound(problem, equations, t_end)
    except InputError as error:
        found = NotApplicable(str(error))
    if isinstance(found, NotApplicable):
        for key in ("error_bound", "error_bound_held"):
            draft.missing(key, found.why)
        return
    rests_on = _of_the_bound(problem)
    if isinstance(found.error, NotApplicable):
        draft.missing("error_bound", found.error.why)
    else:
        draft.guarantee("error_bound", found.error, *rests_on, UP_TO_THE_END)
    draft.guarantee("error_bound_held", found.held, *rests_on)


def _of_the_bound(problem: OutputProblem) -> tuple[Assumption, ...]:
    linear, bounded, start = _rests_on(problem)
    acts = "disturbance at the output" if problem.output_disturbance is not None else ""
    return linear, exact_plant(problem), replace(BOUNDED_D, broken=acts), measured(problem), bounded, start


def _add_at_dc(draft: Draft, equations: Equations) -> None:
    """What no plant changes."""
    Phi, Gamma, c, G = equations.model.Phi, equations.model.Gamma, equations.c, equations.G
    at_rest = np.linalg.solve((np.eye(len(c)) - Phi).T, c)  # c'(I - Phi)^-1
    s, q = at_rest @ Gamma, float(at_rest @ Gamma @ G)
    values = {"sigma_hat_at_dc": (np.outer(G, s) / (1 + q)).tolist(), "disturbance_left": 1 / (1 + q)}
    draft.exact(values, "the controller alone, on a plant that is the model", LINEAR_LOOP)


def _measured(problem: OutputProblem, found: Linearised) -> Array:
    """(s, 1): a state of the plant with y = 1, of which the controller has nothing else; or the sensor's."""
    direction = np.zeros((len(found.loop.A), 1))
    at, C = found.rows["measured"], problem.plant.dynamics.system.C
    direction[at, 0] = 1.0 if problem.sensor_lag is not None else C / (C @ C)
    return direction


def steady_error(problem: OutputProblem, equations: Equations) -> dict[str, float]:
    """What constant r and d leave of e = y - y_m, each per unit: the loop at rest from sample to sample, without f."""
    plant, n = problem.plant.transfer_function, len(equations.c)
    # unknown are x_hat, sigma_hat, y and u; at rest the filter's output is C(0) w_1 - h'w_um
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
    stability, tracking = nothing("stability", unstable(radius)), nothing("tracking", unstable(radius))
    if radius < 1:
        text = f"for every bounded r: a linear loop, spectral radius {radius:.6g} from sample to sample"
        stability = statement("stability", text, *_rests_on(problem))
    if left is not None:
        why = f"not to zero: {left['r']:.3g} of a constant r and {left['d']:.3g} of a constant d are left"
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
        "estimates": advice("estimates", "it estimates no parameters: sigma_hat is what acts on the model"),
        "modelling_error": estimate("modelling_error", "see the margins: they are those of a linear controller"),
        "tuning": advice(
            "tuning",
            "no adaptive gain; C(s) and T alone"
            + ("" if noise is None else f"; noise in y is {noise[0]:.3g} times as large in u"),
        ),
        "margins": margins_cell(certificate),
    }
