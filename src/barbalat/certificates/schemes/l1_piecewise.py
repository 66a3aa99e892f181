"""The certificate of the piecewise-constant L1 law: a linear time-invariant sampled controller, whose loop is known exactly.

With x~ = x_hat - x, x~[k+1] = F x~[k] + S (sigma_hat - sigma)[k] for a sigma that is constant and a state that rests, where F is
the predictor's own step and S what acts in a sample, and sigma_hat = -G x~: so sigma_hat(infinity) = G (I - F + S G)^-1 S sigma,
which is B^-1 e^(A_m T) B in the exact form (F = S G) and B^-1 e^(A_s T) B as flown, never I.
"""

from __future__ import annotations

import numpy as np

from barbalat.certificates.assumptions import bounded_command, exact_plant, measured, undisturbed
from barbalat.certificates.bounds.piecewise_reference import distance
from barbalat.certificates.cells import advice, estimate, margins_cell, nothing, statement
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.entry import Assumption, Entry
from barbalat.certificates.linear_loops.from_sample_to_sample import linearised
from barbalat.certificates.linear_loops.ideal import fast_adaptation
from barbalat.certificates.linear_loops.margin_values import finite
from barbalat.certificates.quantities import Form, Quantity
from barbalat.certificates.rounding import up
from barbalat.certificates.schemes.sampled_loop import LINEAR_CONTROLLER, OF_SAMPLED_LOOPS, add_loop, add_noise, unstable
from barbalat.controllers import L1PiecewiseConstant
from barbalat.controllers.l1_piecewise import Equations, realisation
from barbalat.linear.margins import margins
from barbalat.linear.systems import transfer_function
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import BoundedSignal
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError

OWN_QUANTITIES = OF_SAMPLED_LOOPS | {
    "controller_z": Quantity(
        "the controller's transfer functions to u in z, from each state and from r", form=Form.TRANSFER_FUNCTIONS
    ),
    "disturbance_left": Quantity("share of a constant sigma that sigma_hat leaves, for each of its entries"),
    "sample_time_ratio": Quantity("T as it is over T as the controller's numbers assume it"),
    "baseline_gain": Quantity("u over its baseline at slow frequencies of a state that still moves: 1/(1 - (1 - ratio) C(0))"),
    "delay_margin_reference": Quantity(
        "of the theory's reference system, which the loop tends to with T: beside delay_margin", "s"
    ),
    "reference_distance": Quantity("of every component of x - x_ref at the samples, x_ref of the theory's reference system"),
    "reference_distance_between": Quantity("the same at all times, r held between the samples in the reference system"),
}
NO_LOOP = "margins and noise are known for phi(x) = x: not for this plant"


def certificate(problem: Problem, controller: L1PiecewiseConstant, _: Simulation) -> Certificate:
    """Loop, margins, noise, what is left of a constant disturbance, the distance to the reference system."""
    draft, equations = Draft(own=OWN_QUANTITIES), controller.bind(problem.known)
    _add_of_the_controller(draft, problem, controller, equations)
    if not problem.plant.is_linear:
        for key in ("delay_margin", "reference_distance", "reference_distance_between"):
            draft.missing(key, NO_LOOP)
        return draft.finish()
    found = linearised(problem, controller)
    if add_loop(draft, problem, found, LINEAR_CONTROLLER):
        add_noise(draft, problem, found, np.eye(len(found.loop.A))[:, found.rows["measured"]], LINEAR_CONTROLLER)
    _add_reference(draft, problem, controller)
    return draft.finish()


def _add_of_the_controller(draft: Draft, problem: Problem, controller: L1PiecewiseConstant, equations: Equations) -> None:
    """What no plant changes."""
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
    draft.exact({"baseline_gain": 1 / ratio}, of, "predictor_poles times T are small, and the plant integrates what acts on it")
    if controller.filter is None and ratio >= 2:
        draft.note(
            f"without C(s) a direct estimate is lost at twice the assumed sample time, and here it is {ratio:.3g} times that"
        )


def _transfer_functions(equations: Equations) -> dict[str, dict[str, list[float]]]:
    """Return num and den in z, highest power first, by what they act on: x_1, ..., and r."""
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
    """The distance for every command as large as the case's, and the reference system's own delay margin."""
    levels = np.array([command.bound if isinstance(command, BoundedSignal) else np.nan for command in problem.commands])
    try:
        away = distance(problem, controller, levels)
    except InputError as error:
        for key in ("reference_distance", "reference_distance_between"):
            draft.missing(key, str(error))
    else:
        draft.guarantee("reference_distance", away.at_samples, *rests_on(problem))
        draft.guarantee("reference_distance_between", away.between, *rests_on(problem))
    if controller.as_flown is None and controller.filter is not None and problem.plant.inputs == 1:
        try:
            margin = margins(fast_adaptation(problem.plant, controller.filter.realise())).delay
        except InputError as error:
            draft.missing("delay_margin_reference", str(error))
        else:
            of = "the reference system, broken at the plant input, without what lies before the plant"
            draft.exact({"delay_margin_reference": finite(margin)}, of, LINEAR_CONTROLLER)


def rests_on(problem: Problem) -> tuple[Assumption, ...]:
    """What is guaranteed rests on the case's own theta: no known set is asked for."""
    nonlinear = "" if problem.plant.is_linear else "phi(x) is not x"
    start = Assumption("predictor and reference system start at x(0), the filter at rest")
    linear = Assumption("phi(x) = x, and theta is the case's", nonlinear)
    return exact_plant(problem), undisturbed(problem), measured(problem), bounded_command(problem), start, linear


def column(problem: Problem, controller: L1PiecewiseConstant, certificate: Certificate) -> tuple[str, dict[str, Entry]]:
    """The scheme's name in Table 1 and its cells."""
    values = certificate.values
    radius, away = values.get("spectral_radius"), certificate.entry("reference_distance_between")
    if radius is None or radius >= 1:
        why = NO_LOOP if radius is None else unstable(radius)
        stability = nothing("stability", why)
    else:
        text = f"for every bounded r: a linear loop, spectral radius {radius:.6g} from sample to sample at the case's theta"
        stability = statement("stability", text, *rests_on(problem))
    if away is None or away.value is None:
        transient = nothing("transient", "no bound: " + ("" if away is None else away.why))
    else:
        text = f"x is within {up(away.value)} of the theory's reference system, for every r as large as this one"
        transient = statement("transient", text, *rests_on(problem))
    left = ", ".join(f"{100 * share:.3g} %" for share in values["disturbance_left"])
    noise = values.get("noise_in_u")
    return "L1, piecewise-constant law" + ("" if controller.as_flown is None else ", as flown"), {
        "stability": stability,
        "tracking": nothing("tracking", f"not to zero in general: sigma_hat leaves {left} of what is constant"),
        "transient": transient,
        "estimates": advice("estimates", "it estimates no parameters: sigma_hat is what acts on the plant, one sample late"),
        "modelling_error": estimate("modelling_error", "see the margins: they are those of a linear controller"),
        "tuning": advice(
            "tuning",
            "no adaptive gain; C(s) and T alone"
            + ("" if noise is None else f"; noise in x is {', '.join(f'{one:.3g}' for one in noise)} times as large in u"),
        ),
        "margins": margins_cell(certificate),
    }
