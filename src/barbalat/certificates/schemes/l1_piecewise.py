"""The certificate of the piecewise-constant L1 law: a linear time-invariant sampled controller, whose loop is known exactly.

With x~ = x_hat - x, x~[k+1] = F x~[k] + S (sigma_hat - sigma)[k] for a constant sigma and a constant state, and sigma_hat = -G
x~. F is the step of the predictor, and S the effect of sigma over a sample. Hence sigma_hat(infinity) = G (I - F + S G)^-1 S
sigma, which is B^-1 e^(A_m T) B in the exact form (F = S G) and B^-1 e^(A_s T) B as flown; neither equals I.

``distance`` bounds the distance of the loop from the reference system of its theory, for the plant (1) with phi(x) = x.

x_ref' = A_m x_ref + b (theta'x_ref + u_ref), u_ref = C(s)[k_0 r - theta'x_ref], x_ref(0) = x(0), C at rest, under the sampled
command; as flown u_ref = k_0 r - theta_0'x_ref - C(s)[(theta - theta_0)'x_ref]. Loop and reference system are linear, and their
sampled-data models are exact under held commands. Their difference is therefore one linear system, and the largest effect of a
bounded r on it is the sum of its impulse response.

Between samples a motion differs from the straight line between its ends by at most T^2/8 times its second derivative. With v
held, x'' = e^(A tau) A (A x_k + B v_k), at most e^(|A| T) |A (A x_k + B v_k)| in every component, both for the plant and for the
reference system.

Source of the reference system: Hovakimyan and Cao, L1 Adaptive Control Theory (2010), section 3.3, where C(s) acts in continuous
time and the bound goes to zero with T.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from barbalat.certificates.assumptions import bounded_command, exact_plant, measured, of_linear_loop, undisturbed
from barbalat.certificates.cells import advice, estimate, margins_cell, nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption, Entry
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.linear_loops.from_sample_to_sample import linearised
from barbalat.certificates.linear_loops.ideal import fast_adaptation
from barbalat.certificates.linear_loops.margin_values import finite
from barbalat.certificates.quantities import Form, Quantity
from barbalat.certificates.rows import up
from barbalat.certificates.schemes import bounded_response
from barbalat.certificates.schemes.sampled_loop import LINEAR_CONTROLLER, OF_SAMPLED_LOOPS, add_loop, add_noise, unstable
from barbalat.controllers.l1_piecewise import Equations, L1PiecewiseConstant, realisation, started
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.linear.margins import margins
from barbalat.linear.sampled_norms import SampledNorms, grown
from barbalat.linear.systems import StateSpace, transfer_function
from barbalat.linear.zero_order_hold import HeldSystem
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import BoundedSignal
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError


class Distance(NamedTuple):
    """The largest component of |x - x_ref|."""

    at_samples: float
    between: float  # at all times


def distance(problem: Problem, controller: L1PiecewiseConstant, levels: Array) -> Distance:
    """The distance to the reference system for held commands of these sizes (q,); raises InputError if either of them is
    unstable."""
    equations, plant = controller.bind(problem.known), problem.plant
    T, n, q = controller.sample_time, plant.n, len(levels)
    single = StateSpace.gain(1.0) if controller.filter is None else controller.filter.realise()
    A, B = _reference(problem, equations, single)
    if not np.linalg.eigvals(A).real.max() < 0:
        raise InputError("its reference system is unstable")
    held, found = HeldSystem.of(A, B, T), realisation(equations)
    M, N = _sampled(problem, equations, T)
    a, r, b = len(M), len(A), plant.b.reshape(n, -1)
    free = np.concatenate([plant.x0, started(equations, plant.x0, np.zeros(q)), plant.x0, np.zeros(r - n)])
    # the filter's first sample is not one of its steps, so the first command is in the initial state too
    first = np.array([started(equations, np.zeros(n), unit) for unit in np.eye(q)]).T
    first = np.vstack([np.zeros((n, q)), first, np.zeros((r, q))])
    whole = np.block([[M, np.zeros((a, r))], [np.zeros((r, a)), held.Phi]])
    command = np.vstack([N, held.Gamma])

    def largest(C: Array, D: Array) -> Array:
        """The largest |C z + D r| at the samples, with the state z of ``whole``."""
        norms = SampledNorms(whole, C)
        driven = norms.summed(command) + norms.largest(first) + np.abs(D)
        return np.asarray(driven @ levels + norms.largest(free[:, None])[:, 0])

    at_samples = float(largest(np.hstack([np.eye(n, a), -np.eye(n, r)]), np.zeros((n, q))).max())
    of_x, of_r = found.D[:, :n], found.D[:, n:]
    slope_x = np.hstack([plant.A + b @ of_x, b @ found.C, np.zeros((n, r))])
    slope_ref = np.hstack([np.zeros((r, a)), A])
    curved = grown(plant.A, T) @ largest(plant.A @ slope_x, plant.A @ b @ of_r)
    curved = curved + (grown(A, T) @ largest(A @ slope_ref, A @ B))[:n]
    return Distance(at_samples, float(at_samples + T**2 / 8 * curved.max()) * OUTWARD_FACTOR)


def _sampled(problem: Problem, equations: Equations, T: float) -> tuple[Array, Array]:
    """(x, s)[k+1] = M (x, s)[k] + N r[k], with the controller's realisation s."""
    plant, found = problem.plant, realisation(equations)
    n = plant.n
    held = HeldSystem.of(plant.A, plant.b.reshape(n, -1), T)
    of_x, of_r = found.D[:, :n], found.D[:, n:]
    M = np.block([[held.Phi + held.Gamma @ of_x, held.Gamma @ found.C], [found.B[:, :n], found.A]])
    return M, np.vstack([held.Gamma @ of_r, found.B[:, n:]])


def _reference(problem: Problem, equations: Equations, C: StateSpace) -> tuple[Array, Array]:
    """(A, B) of (x_ref, the filter's state) under r."""
    plant, n, m = problem.plant, problem.plant.n, problem.plant.inputs
    b, theta = plant.b.reshape(n, m), plant.theta.reshape(n, m).T
    baseline = np.zeros((m, n)) if equations.direct is None else equations.direct.reshape(n, m).T
    left = theta - baseline
    passed = np.zeros_like(equations.k_0) if equations.direct is not None else equations.k_0
    beside = equations.k_0 - passed
    A_z, B_z, C_z = (np.kron(np.eye(m), part) for part in (C.A, C.B[:, None], C.C[None, :]))
    A = np.block([[plant.A - b @ (baseline + C.D * left), b @ C_z], [-B_z @ left, A_z]])
    return A, np.vstack([b @ (beside + C.D * passed), B_z @ passed])


OWN_QUANTITIES = (
    OF_SAMPLED_LOOPS
    | bounded_response.OF_RESPONSES
    | {
        "controller_z": Quantity(
            "the controller's transfer functions to u in z, from each state and from r", form=Form.TRANSFER_FUNCTIONS
        ),
        "disturbance_left": Quantity("fraction of a constant sigma that sigma_hat does not include, for each entry"),
        "sample_time_ratio": Quantity("ratio of T to the sample time for which the controller was designed"),
        "baseline_gain": Quantity(
            "ratio of u to its baseline part at low frequencies while the state still moves: 1/(1 - (1 - ratio) C(0))"
        ),
        "delay_margin_reference": Quantity(
            "delay margin of the theory's reference system, to which the loop tends as T falls; compare with delay_margin", "s"
        ),
        "reference_distance": Quantity(
            "bound on every component of x - x_ref at the samples; x_ref is the state of the theory's reference system"
        ),
        "reference_distance_between": Quantity("the same at all times, if r is held between samples in the reference system"),
    }
)
NO_LOOP = "margins and noise are known only for phi(x) = x, not for this plant"


def certificate(problem: Problem, controller: L1PiecewiseConstant, simulation: Simulation) -> Certificate:
    """The values for the linear loop: margins, noise, the steady error under a constant disturbance, and the distance to the
    reference system."""
    draft, equations = Draft(own=OWN_QUANTITIES), controller.bind(problem.known)
    _add_of_the_controller(draft, problem, controller, equations)
    if not problem.plant.is_linear:
        draft.all_missing(("delay_margin", "reference_distance", "reference_distance_between"), NO_LOOP)
        return draft.finish()
    found = linearised(problem, controller)
    bounded_response.add(draft, problem, controller, simulation.t_end)
    if add_loop(draft, problem, found, LINEAR_CONTROLLER):
        add_noise(draft, problem, found, np.eye(len(found.loop.A))[:, found.rows["measured"]], LINEAR_CONTROLLER)
        if problem.plant.inputs == 1:
            over_known_set.add_sampled(draft, problem, found)
    _add_reference(draft, problem, controller)
    return draft.finish()


def _add_of_the_controller(draft: Draft, problem: Problem, controller: L1PiecewiseConstant, equations: Equations) -> None:
    """Add values that don't depend on the plant: the estimate of a constant sigma, the transfer functions, the ratio of the
    sample times."""
    p, n = equations.predictor, problem.plant.n
    at_dc = p.G @ np.linalg.solve(np.eye(n) - p.of_x_hat + p.of_acting @ p.G, p.of_acting)
    of = "the controller alone"
    draft.exact({"sigma_hat_at_dc": at_dc.tolist(), "disturbance_left": (1 - np.diag(at_dc)).tolist()}, of, LINEAR_CONTROLLER)
    if problem.plant.is_linear and problem.plant.inputs == 1:
        draft.exact({"controller_z": _transfer_functions(equations)}, of, LINEAR_CONTROLLER)
    if controller.as_flown is None:
        return
    ratio = controller.sample_time / controller.assumed_sample_time
    draft.exact({"sample_time_ratio": ratio}, of, "the loop runs at sample_time")
    draft.exact({"baseline_gain": 1 / ratio}, of, "predictor_poles times T are small, and the plant integrates its inputs")
    if controller.filter is None and ratio >= 2:
        draft.note(
            f"without C(s) a direct estimate is unstable at twice the assumed sample time, but here the sample time is "
            f"{ratio:.3g} times the assumed one"
        )


def _transfer_functions(equations: Equations) -> dict[str, dict[str, list[float]]]:
    """Return num and den in z, highest power first, by the signal that they act on: x_1, ..., and r."""
    A, B, C, D = realisation(equations)
    n = len(equations.x0)
    names = [
        *(f"x_{i + 1}" for i in range(n)),
        *(["r"] if B.shape[1] == n + 1 else [f"r_{j + 1}" for j in range(B.shape[1] - n)]),
    ]
    found = {}
    for i, name in enumerate(names):
        proper = transfer_function(C[0], A, B[:, i])
        found[name] = {"num": np.polyadd(proper.num, D[0, i] * proper.den).tolist(), "den": proper.den.tolist()}
    return found


def _add_reference(draft: Draft, problem: Problem, controller: L1PiecewiseConstant) -> None:
    """Add the distance for every command no larger than that of the case, and the delay margin of the reference system."""
    levels = np.array([command.bound if isinstance(command, BoundedSignal) else np.nan for command in problem.commands])
    try:
        away = distance(problem, controller, levels)
    except InputError as error:
        draft.all_missing(("reference_distance", "reference_distance_between"), str(error))
    else:
        draft.guarantee("reference_distance", away.at_samples, *rests_on(problem))
        draft.guarantee("reference_distance_between", away.between, *rests_on(problem))
    if controller.as_flown is None and controller.filter is not None and problem.plant.inputs == 1:
        try:
            margin = margins(fast_adaptation(problem.plant, controller.filter.realise())).delay
        except InputError as error:
            draft.missing("delay_margin_reference", str(error))
        else:
            of = "the reference system, broken at the plant input, without input dynamics"
            draft.exact({"delay_margin_reference": finite(margin)}, of, LINEAR_CONTROLLER)


def rests_on(problem: Problem) -> tuple[Assumption, ...]:
    """The assumptions of the guarantees, which use the theta of the case and need no known set."""
    nonlinear = "" if problem.plant.is_linear else "phi(x) is not x"
    start = Assumption("predictor and reference system start at x(0), the filter at rest")
    linear = Assumption("phi(x) = x, and theta is the one given in the case", nonlinear)
    plant = exact_plant(problem), undisturbed(problem), measured(problem), bounded_command(problem)
    return of_linear_loop(*plant, start, linear)


def column(problem: Problem, controller: L1PiecewiseConstant, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    values = certificate.values
    radius, away = values.get("spectral_radius"), certificate.entry("reference_distance_between")
    if radius is None or radius >= 1:
        why = NO_LOOP if radius is None else unstable(radius)
        stability = nothing("stability", why, *rests_on(problem))
    else:
        text = f"for every bounded r: a linear sampled-data loop with spectral radius {radius:.6g} at the case's theta"
        stability = statement("stability", text, *rests_on(problem))
    if away is None or away.value is None:
        transient = nothing("transient", "no bound: " + ("" if away is None else away.why))
    else:
        text = f"x is within {up(away.value)} of the theory's reference system, for every r within the case's bound, at its theta"
        transient = statement("transient", text, *rests_on(problem))
    left = ", ".join(f"{100 * share:.3g} %" for share in values["disturbance_left"])
    noise = values.get("noise_in_u")
    return "L1, piecewise-constant law" + ("" if controller.as_flown is None else ", as flown"), {
        "stability": stability,
        "tracking": nothing(
            "tracking",
            f"e does not converge to zero in general: sigma_hat does not cover a fraction {left} of a constant disturbance",
        ),
        "transient": transient,
        "estimates": advice(
            "estimates", "it does not estimate parameters: sigma_hat is the total input disturbance, delayed by one sample"
        ),
        "modelling_error": estimate("modelling_error", "see the margins, which are those of a linear controller"),
        "tuning": advice(
            "tuning",
            "no adaptive gain, only C(s) and T"
            + ("" if noise is None else f"; noise in x is amplified by {', '.join(f'{one:.3g}' for one in noise)} in u"),
        ),
        "margins": margins_cell(certificate),
    } | ({} if away is not None and away.applies else bounded_response.cells(certificate))
