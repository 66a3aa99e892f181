"""The margins of linear sampled schemes, whose sampled-data loop is known exactly."""

from __future__ import annotations

import warnings

import numpy as np

from barbalat.certificates.certificate import Draft
from barbalat.certificates.entry import PlaceOfRest
from barbalat.certificates.linear_loops.from_sample_to_sample import Linearised
from barbalat.certificates.linear_loops.margin_values import KEYS_OF_MARGINS, finite, in_the_loop
from barbalat.certificates.quantities import EACH_INPUT, Form, Quantity
from barbalat.certificates.requested_keys import is_needed
from barbalat.certificates.schemes import LinearFile, scheme_file
from barbalat.controllers import Sampled
from barbalat.controllers.l1_piecewise import L1PiecewiseConstant
from barbalat.linear.margins import margins
from barbalat.linear.peaks import peak_gain
from barbalat.linear.sampled_loop import SampledLoop, delay_margin, gain_margins
from barbalat.linear.systems import complementary_sensitivity, sensitivity
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.validate import Array, InputError

OF_SAMPLED_LOOPS = {
    "spectral_radius": Quantity("spectral radius of the sampled-data closed loop: stable below 1"),
    "spectral_radius_adapting": Quantity("the same including its law, at the equilibrium under the largest constant command"),
    "sample_time_max": Quantity(
        "largest sample time, starting from the current one, at which that loop with its law is stable", "s"
    ),
    "noise_in_sigma_hat": Quantity("standard deviation of sigma_hat for independent measurement noise of standard deviation 1"),
    "noise_in_u": Quantity("the same for u"),
    "sigma_hat_at_dc": Quantity("sigma_hat for a constant sigma at equilibrium, row by row; it is not I", form=Form.MATRIX),
}
LINEAR_CONTROLLER = "the sampled controller is linear and time-invariant, phi(x) = x, and no limit acts"
WHITE_NOISE = "the noise of different samples is independent"
OF_THE_LOOP = "in sampled-data form with the true parameters, broken at the plant input"


def linear_because(problem: TrackingProblem, controller: Controller) -> str | None:
    """The reason why a controller, sampled or not, is linear on this plant; None if it is not linear."""
    if isinstance(controller, L1PiecewiseConstant):
        return LINEAR_CONTROLLER
    continuous = controller.controller if isinstance(controller, Sampled) else controller
    file = scheme_file(continuous)
    return file.linear_when(problem, continuous) if isinstance(file, LinearFile) else None


def name_of(problem: TrackingProblem) -> str:
    """The name of the loop to which the exact values of the certificate belong."""
    return OF_THE_LOOP + in_the_loop(problem)


def add_loop(
    draft: Draft, problem: TrackingProblem, found: Linearised, linear: str, name: str = "", rest: PlaceOfRest | None = None
) -> bool:
    """Add the spectral radius of the loop and, if it is stable, its margins; return whether it is stable.

    linear  why the controller is linear
    name    name of the loop; by default the loop with the true parameters
    """
    radius, name = found.loop.radius(problem.delay), name or name_of(problem)
    draft.exact({"spectral_radius": radius}, name, linear, rest=rest)
    if radius < 1:
        add_margins(draft, problem, found, linear, name, rest)
    else:
        draft.missing("delay_margin", unstable(radius))
    return radius < 1


def unstable(radius: float) -> str:
    """The reason why an unstable loop has no margins."""
    return f"the sampled-data loop is unstable: spectral radius {radius:.6g}"


def add_margins(
    draft: Draft, problem: TrackingProblem, found: Linearised, linear: str, name: str, rest: PlaceOfRest | None
) -> None:
    """Add the margins of the loop including its delay; the delay margin is the additional delay that it tolerates."""
    loop = found.loop
    try:
        delay = delay_margin(loop, problem.delay)
    except InputError as error:
        draft.missing("delay_margin", str(error))
    else:
        draft.exact({"delay_margin": finite(delay)}, name, linear, rest=rest)
    draft.advise({"margins_of": f"the linear loop {name}"})
    if loop.inputs > 1:
        _add_of_several(draft, problem, loop, name, linear, rest)
        return
    try:
        values = _at_one_input(loop, problem.delay, 0)
    except InputError as error:
        draft.note(f"linear loop {name}: {error}")
        return
    draft.exact(values, name, linear, rest=rest)


def _at_one_input(loop: SampledLoop, delay: float, i: int) -> dict[str, float | None]:
    """Gain and phase margins and peaks of the loop broken at one input, with the others closed."""
    L = loop.as_continuous(delay, i)
    of_L = margins(L)
    values = {key: finite(getattr(of_L, one)) for one, key in KEYS_OF_MARGINS.items() if one != "delay"}
    peaks = {"sensitivity_peak": sensitivity, "complementary_sensitivity_peak": complementary_sensitivity}
    return values | {key: peak_gain(of(L)).gain for key, of in peaks.items()}


def _add_of_several(
    draft: Draft, problem: TrackingProblem, loop: SampledLoop, name: str, linear: str, rest: PlaceOfRest | None
) -> None:
    """Add the margins of several inputs: for a common factor on all inputs, and for each input alone."""
    delay = problem.delay
    draft.note(
        "gain_margin, gain_reduction_margin and delay_margin are for a common factor or delay in all inputs; the keys with _each "
        "are for one input separately"
    )
    down, up = gain_margins(loop, delay)
    draft.exact({"gain_margin": finite(up), "gain_reduction_margin": down}, f"{name}, at all inputs together", linear, rest=rest)
    if not is_needed(*EACH_INPUT.values()):
        return
    alone = f"{name}, at one input separately"
    try:
        each = [_at_one_input(loop, delay, i) for i in range(loop.inputs)]
    except InputError as error:
        draft.note(f"linear loop {alone}: {error}")
    else:
        values = {of_each: [one[key] for one in each] for key, of_each in EACH_INPUT.items() if key in each[0]}
        draft.exact(values, alone, linear, rest=rest)
    try:
        delays = [finite(delay_margin(loop, delay, i)) for i in range(loop.inputs)]
    except InputError as error:
        draft.missing("delay_margin_each", str(error))
    else:
        draft.exact({"delay_margin_each": delays}, alone, linear, rest=rest)


def add_noise(draft: Draft, problem: TrackingProblem, found: Linearised, measured: Array, linear: str) -> None:
    """Add the standard deviations of sigma_hat and u just after a sample, from the stationary covariance; ``measured`` (s, q)
    selects the measurements in X."""
    from scipy.linalg import LinAlgError, LinAlgWarning, solve_discrete_lyapunov

    loop, rows = found.loop, found.rows
    closed, s = loop.closed(problem.delay), len(loop.A)
    enters = loop.J @ measured
    outside = np.concatenate([rows["u"], *(rows[name] for name in ("x_hat", "sigma_hat", "filter")), rows["held"]])
    enters[np.setdiff1d(np.arange(s), outside)] = 0.0  # the plant and its sensor have no noise
    N = np.vstack([enters, np.zeros((len(closed) - s, enters.shape[1]))])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", LinAlgWarning)
            covariance = solve_discrete_lyapunov(closed, N @ N.T)
    except (LinAlgError, LinAlgWarning):
        draft.all_missing(
            ("noise_in_sigma_hat", "noise_in_u"),
            "the sampled-data loop is too close to instability for a covariance",
        )
        return
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    values = {"noise_in_sigma_hat": deviation[rows["sigma_hat"]].tolist(), "noise_in_u": deviation[rows["u"]].tolist()}
    draft.exact(values, name_of(problem), linear, WHITE_NOISE)
