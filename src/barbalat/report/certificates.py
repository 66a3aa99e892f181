"""Certificates as rows of text, for the terminal and for pages: what each value means, and whether it is guaranteed."""

from __future__ import annotations

from typing import Any, NamedTuple

from barbalat.certificates.certificate import Certificate
from barbalat.certificates.rounding import down, up
from barbalat.report.numbers import number_text

MEANINGS = {
    "nu_0": "|theta_tilde(0)|/sqrt(lambda_min(P))",
    "nu_0_worst": "the same for the worst theta of the known set",
    "initial_parameter_error": "|theta_tilde(0)|",
    "P": "P A_m + A_m'P = -I, row by row",
    "lambda_min": "of P, from below",
    "theta_max": "largest |theta|_1 of the known set",
    "kappa_admissible": "largest kappa found for which the condition holds with C = 1/(kappa s + 1) [s]",
    "kappa_max": "1/(theta_max ||sW_b||_1) of Theorem 1 [s]",
    "nu_1": "of (10)",
    "nu_2": "of (10)",
    "error_bound": "of every component of e, at all times",
    "error_bound_worst": "the same for the worst theta of the known set",
    "adaptation_frequency": "of the frozen oscillator of adaptation [rad/s]",
    "gamma_max": "largest gain that the solver, or a law that takes Euler steps, bears at its step",
    "step_max": "largest step that the gain bears [s]",
    "delay_margin": "smallest destabilising delay [s]",
    "phase_margin": "[rad]",
    "gain_margin": "factor",
    "gain_reduction_margin": "factor",
    "sensitivity_peak": "max |S|",
    "complementary_sensitivity_peak": "max |T|",
    "margins_of": "the margins above are of",
    "unlimited": "what nothing exhausts",
    "delay_margin_adapting": "linearised at the largest constant command, its law included [s]",
    "delay_onset_simulated": "measured: largest delay before the loop oscillates, see below [s]",
    "delay_margin_simulated": "measured: largest delay before it is lost, see below [s]",
    "delay_margin_limit": "the same for gamma -> infinity [s]",
    "linear_equivalent": "u = feedforward[r] - feedback[y] while sigma is inside its bounds",
    "linear_equivalent_limit": "the same for gamma -> infinity",
    "output_bound": "of |y| before what is added at the output, up to t_end",
    "sigma_needed": "bound of |sigma| while the projection does not act",
    "steady_error": "what constant r and d leave of e without f",
    "slope": "of f(t, y) in y within that bound",
    "theta_star": "parameters with which the plant is the model",
    "tau_below": "1/delta_0, which tau must stay below (Theorem 2) [s]",
    "mu_parameters": "mu against the known set",
    "parameter_scale": "factor by which the known set may grow",
    "theta_destabilising": "parameters that destabilise",
    "mu_dynamics": "mu against the unmodelled dynamics",
    "mu": "mu against both",
    "mu_frequency": "where it peaks [rad/s]",
}
OF_LINEAR_LOOPS = frozenset(
    {"delay_margin", "phase_margin", "gain_margin", "gain_reduction_margin", "sensitivity_peak"}
    | {"complementary_sensitivity_peak", "delay_margin_adapting", "delay_margin_limit"}
)
"""Exact for the linear loop that is named."""
BOUNDS = {"r": "of |r|, at all times", "x_m": "of every component of x_m, at all times"}
LOWER_BOUNDS = frozenset({"kappa_admissible", "kappa_max", "lambda_min"})
"""Guaranteed values that hold for everything below them; the others are upper bounds."""
ROUNDING = 1e-12
"""Of a value per unit: below it stands zero."""


class Row(NamedTuple):
    """``kind`` is "guaranteed", "estimate", "linear loop" for what is exact of one, or empty for what is none of these."""

    quantity: str
    value: str
    meaning: str
    kind: str


def rows(certificate: Certificate) -> list[Row]:
    """All values in order; guaranteed ones rounded so that the print is a bound too."""
    found: list[Row] = []
    for key, value in certificate.values.items():
        if value is None:
            continue
        kind = "guaranteed" if key in certificate.guaranteed else _kind(key)
        if key == "norms":
            found += [
                Row(f"||{n}||_1", f"{down(e['lower'], 10)} ... {up(e['upper'], 10)}", "L1 norm", kind) for n, e in value.items()
            ]
        elif key == "P":
            found.append(Row(key, number_text(value, "; "), MEANINGS[key], ""))
        elif key == "bounds":
            found += [Row(f"sup |{name}|", _text(name, bound, kind), BOUNDS[name], kind) for name, bound in value.items()]
        elif key == "condition":
            found.append(_condition(value, kind))
        elif key == "margins_over_known_set":
            found += [row for entry in value for row in _worst_case(entry)]
        elif key in ("linear_equivalent", "linear_equivalent_limit"):
            found += [_coefficients(f"{key}, {name}", system, MEANINGS[key]) for name, system in value.items()]
        elif key == "steady_error":
            left = ", ".join(f"{0 if abs(v) < ROUNDING else v:.4g} {name}" for name, v in value.items())
            found.append(Row(key, left, MEANINGS[key], "linear loop"))
        elif key == "unlimited":
            found.append(Row(key, ", ".join(value), MEANINGS[key], ""))
        elif isinstance(value, str):
            found.append(Row(key, value, MEANINGS.get(key, ""), ""))
        else:
            found.append(Row(key, _text(key, value, kind), MEANINGS.get(key, ""), kind))
    return found


def _kind(key: str) -> str:
    return "linear loop" if key in OF_LINEAR_LOOPS else "" if key == "tau_below" else "estimate"


def _text(key: str, value: Any, kind: str) -> str:
    if not isinstance(value, float):
        return number_text(value)
    if kind == "guaranteed":
        return (down if key in LOWER_BOUNDS else up)(value, 6)
    return f"{value:.6g}"


def _condition(value: dict[str, Any], kind: str) -> Row:
    quantity = f"||{value.get('of', 'W_b (1 - C)')}||_1 {value.get('times', 'theta_max')}"
    if value["value_upper"] is None:
        return Row(quantity, "infinite", "condition < 1 fails", kind)
    verdict = "< 1: holds" if value["holds"] else "not shown to be below 1"
    return Row(quantity, f"<= {up(value['value_upper'], 6)}", f"condition {verdict}", kind)


def _coefficients(quantity: str, system: dict[str, list[float]], meaning: str) -> Row:
    """A transfer function, highest power first."""
    text = ", ".join(f"{side} = [{number_text(values)}]" for side, values in system.items())
    return Row(quantity, text, meaning, "linear loop")


def _worst_case(entry: dict[str, Any]) -> list[Row]:
    """The margins of one linear loop over the known set."""
    found = [Row("over the known set", entry["of"], f"searched: {entry['searched']}", "")]
    for key, value in entry.items():
        if isinstance(value, dict):
            text = f"{value['value']:.6g} at theta = [{number_text(value['theta'])}]"
            found.append(Row(f"- {key}", text, MEANINGS[key], "estimate"))
    if entry["unlimited"]:
        found.append(Row("- unlimited", ", ".join(entry["unlimited"]), "at every theta looked at", ""))
    if "unstable_at" in entry:
        found.append(Row("- unstable at", f"theta = [{number_text(entry['unstable_at'])}]", "", ""))
    return found
