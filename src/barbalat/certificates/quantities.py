"""The keys of a certificate: what each value means, and its unit. ``docs/`` and the command line print these words."""

from __future__ import annotations

from typing import NamedTuple


class Quantity(NamedTuple):
    """What a key stands for; ``below`` marks a guarantee that holds for everything below the value instead of above it."""

    meaning: str
    unit: str = ""
    below: bool = False


QUANTITIES = {
    "nu_0": Quantity("|theta_tilde(0)|/sqrt(lambda_min(P))"),
    "nu_0_worst": Quantity("the same for the worst theta of the known set"),
    "initial_parameter_error": Quantity("|theta_tilde(0)|"),
    "P": Quantity("P A_m + A_m'P = -I, row by row"),
    "lambda_min": Quantity("of P, from below", below=True),
    "theta_max": Quantity("largest |theta|_1 of the known set"),
    "bounds": Quantity("of |r| and of every component of x_m, at all times"),
    "norms": Quantity("L1 norms, enclosed"),
    "condition": Quantity("a norm times a size, below 1 where the condition holds"),
    "kappa_admissible": Quantity("largest kappa found for which the condition holds with C = 1/(kappa s + 1)", "s", below=True),
    "kappa_max": Quantity("1/(theta_max ||sW_b||_1) of Theorem 1", "s", below=True),
    "nu_1": Quantity("of (10)"),
    "nu_2": Quantity("of (10)"),
    "error_bound": Quantity("of every component of e, at all times"),
    "error_bound_worst": Quantity("the same for the worst theta of the known set"),
    "reference_error_bound": Quantity("of every component of x - x_ref, the filtered loop with theta known, at all times"),
    "adaptation_frequency": Quantity("of the frozen oscillator of adaptation", "rad/s"),
    "gamma_max": Quantity("gain that the solver, or a law that takes Euler steps, bears at its step at least: |x| at its bound"),
    "step_max": Quantity("step that the gain bears at least: |x| at its bound", "s"),
    "gamma_max_at_model": Quantity("the same with |x| as large as the command makes |x_m|: above it oscillations are due"),
    "step_max_at_model": Quantity("the same with |x| as large as the command makes |x_m|: above it oscillations are due", "s"),
    "delay_margin": Quantity("smallest destabilising delay", "s"),
    "phase_margin": Quantity("smallest destabilising phase lag", "rad"),
    "gain_margin": Quantity("smallest destabilising factor above 1"),
    "gain_reduction_margin": Quantity("largest destabilising factor below 1"),
    "sensitivity_peak": Quantity("max |S|"),
    "complementary_sensitivity_peak": Quantity("max |T|"),
    "margins_of": Quantity("the margins above are of"),
    "unlimited": Quantity("the margins that no size exhausts"),
    "margins_over_known_set": Quantity("the least margins found over the known set, and where"),
    "delay_margin_adapting": Quantity("linearised at the largest constant command, its law included", "s"),
    "delay_onset_simulated": Quantity("measured: largest delay before the loop oscillates, see below", "s"),
    "delay_margin_simulated": Quantity("measured: largest delay before it is lost, see below", "s"),
    "delay_margin_limit": Quantity("the same for gamma -> infinity", "s"),
    "linear_equivalent": Quantity("u = feedforward[r] - feedback[y] while sigma is inside its bounds"),
    "linear_equivalent_limit": Quantity("the same for gamma -> infinity"),
    "output_bound": Quantity("of |y| before what is added at the output, up to t_end"),
    "sigma_needed": Quantity("bound of |sigma| while the projection does not act"),
    "steady_error": Quantity("what constant r and d leave of e without f"),
    "slope": Quantity("of f(t, y) in y within that bound"),
    "theta_star": Quantity("parameters with which the plant is the model"),
    "tau_below": Quantity("1/delta_0, which tau must stay below (Theorem 2)", "s"),
    "mu_parameters": Quantity("mu against the known set"),
    "parameter_scale": Quantity("factor by which the known set may grow"),
    "theta_destabilising": Quantity("parameters that destabilise"),
    "mu_dynamics": Quantity("mu against the unmodelled dynamics"),
    "mu": Quantity("mu against both"),
    "mu_frequency": Quantity("where it peaks", "rad/s"),
}
