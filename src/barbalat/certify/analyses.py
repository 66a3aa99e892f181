"""What is guaranteed of each scheme, as statements with the case's constants: the entries of Table 1, see docs/table-1.md."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

from barbalat.adaptation.epsilon_modification import EpsilonModification
from barbalat.adaptation.fixed_sigma import FixedSigma
from barbalat.certify import laws
from barbalat.certify.rounding import down, up
from barbalat.controllers import L1Adaptive, LinearFeedback, Mrac, NormalizedMrac, RobustMrac
from barbalat.controllers.robust_mrac import minimum_phase_model
from barbalat.problem import Problem


class Cell(NamedTuple):
    """A statement; "proven" holds under the column's assumptions, an "estimate" is advice."""

    kind: Literal["proven", "not proven", "estimate"]
    text: str


NONLINEAR = "known for phi(x) = x; where phi grows faster, a normalised law may be too slow to keep x bounded"

Analysis = Callable[[Any, Any, dict[str, Any]], tuple[str, dict[str, Cell]]]
"""From the problem, the controller and its certificate's values to the scheme's name and its statements."""


def _mrac(problem: Problem, controller: Mrac, values: dict[str, Any]) -> tuple[str, dict[str, Cell]]:
    void = laws.why_no_bound(controller, problem)
    cells = {
        "stability": Cell("proven", "for every Gamma > 0 and every bounded r"),
        "tracking": Cell("proven", "converges to zero for every bounded r") if void is None else Cell("not proven", void),
        "estimates": _lyapunov_estimates(problem, controller),
        "modelling_error": _unproven_robustness(problem, controller),
        "tuning": Cell("estimate", "the bound falls with 1/sqrt(Gamma); " + limits_text(values)),
        "margins": margins_cell(values),
    }
    if "error_bound" in values:
        text = f"|e| <= nu_0/sqrt(Gamma) = {up(values['error_bound'])} at all times, (9)"
        if "error_bound_worst" in values:
            text += f"; {up(values['error_bound_worst'])} for the worst theta of the known set"
        cells["transient"] = Cell("proven", text)
    else:
        cells["transient"] = Cell("not proven", "no bound")
    return "standard MRAC (3)-(4)", cells


def _l1(problem: Problem, controller: L1Adaptive, values: dict[str, Any]) -> tuple[str, dict[str, Cell]]:
    if controller.filter is None:
        _, cells = _mrac(problem, controller, values)  # type: ignore[arg-type]  # with C = 1 the two coincide
        return "filtered MRAC (5)-(8) with C = 1, the standard MRAC", cells
    condition = values.get("condition")
    void = laws.why_no_bound(controller, problem)
    if condition is None and _projected(problem, controller):
        why = Cell("not proven", "the condition on C(s) is not known for this plant")
    elif condition is None:
        why = Cell("not proven", "without a known set that is projected onto there is no theta_max for the condition on C(s)")
    elif not condition["holds"]:
        value = up(condition["value_upper"])
        why = Cell("not proven", f"||W_b (1 - C)||_1 theta_max is only known to be <= {value}, and 1 is needed")
    else:
        why = Cell("proven", f"since ||W_b (1 - C)||_1 theta_max <= {up(condition['value_upper'])} < 1")
    transient = Cell("not proven", void or "no bound")
    if "error_bound" in values:
        transient = Cell(
            "proven", f"|e| <= {up(values['error_bound'])} at all times, (10); the filter's part stays however large Gamma is"
        )
    tuning = [limits_text(values)]
    if values.get("kappa_admissible") is not None:
        tuning.append(f"with C = 1/(kappa s + 1) the condition holds up to kappa = {down(values['kappa_admissible'])} s")
    vanishes = (
        "not to zero in general: an error of the order of the filter's lag stays; to zero for a constant r (Theorem 1 (iii))"
    )
    return "filtered MRAC, L1-AC (5)-(8)", {
        "stability": why,
        "tracking": Cell("not proven", vanishes if why.kind == "proven" else "nothing, without bounded signals"),
        "transient": transient,
        "estimates": _lyapunov_estimates(problem, controller),
        "modelling_error": _unproven_robustness(problem, controller),
        "tuning": Cell("estimate", "; ".join(tuning)),
        "margins": margins_cell(values),
    }


def _normalized(problem: Problem, controller: NormalizedMrac | RobustMrac, values: dict[str, Any]) -> tuple[str, dict[str, Cell]]:
    sentence, law = laws.convergence(controller.law, controller.bind(problem.known).box), controller.law
    to_zero, nothing = sentence.startswith("the tracking error converges to zero"), "nothing is guaranteed" in sentence
    cut = "corners" in sentence
    pulled = isinstance(law.leakage, (FixedSigma, EpsilonModification))  # type: ignore[attr-defined]
    settled = "V of the law never grows; they converge to theta where phi/m_s is persistently exciting"
    pull = "bounded, and pulled towards zero"
    cells = {
        "stability": Cell("not proven", sentence) if nothing else Cell("proven", "for every bounded r"),
        "tracking": Cell("proven", "converges to zero for every bounded r") if to_zero else Cell("not proven", sentence),
        "transient": Cell("not proven", "no bound before the estimates have settled"),
        "estimates": Cell("not proven", sentence) if cut else Cell("proven", pull if pulled else settled),
        "modelling_error": Cell("not proven", sentence) if nothing else _normalized_robustness(problem, controller),
        "tuning": Cell("estimate", limits_text(values)),
        "margins": margins_cell(values),
    }
    if not problem.plant.is_linear:  # the proof of boundedness needs |phi(x)| <= c |x|
        cells |= dict.fromkeys(("stability", "tracking", "modelling_error"), Cell("not proven", NONLINEAR))
    if not isinstance(controller, RobustMrac):
        return "normalised MRAC", cells
    degree = minimum_phase_model(controller.bind(problem.known).c_0, problem.known).relative_degree
    power = "" if degree == 1 else f"^{degree}"
    kept = f"the auxiliary input leaves 1 - 1/(tau s + 1){power} of c_0'e, of the order of tau; no number bounds it"
    ceiling = 1 / controller.normalization.delta_0
    window = f"tau_min < tau = {controller.tau:g} s < 1/delta_0 = {down(ceiling)} s (Theorem 2; tau_min grows with Delta)"
    printed = Cell("not proven", "with the sign of (14) as printed the auxiliary input does not cancel the error")
    cells["transient"] = printed if controller.printed_sign else Cell("proven", kept)
    cells["tuning"] = Cell("estimate", f"{window}; {limits_text(values)}")
    return "robust MRAC (14)-(16)", cells


def _normalized_robustness(problem: Problem, controller: NormalizedMrac | RobustMrac) -> Cell:
    if controller.normalization.alpha_0 == 0:
        return Cell("not proven", "needs the dynamic normalisation, alpha_0 > 0 in (16); it is 0 here")
    if not _projected(problem, controller) and controller.law.leakage is None:  # type: ignore[attr-defined]
        return Cell("not proven", "needs projection or leakage, and there is neither")
    return Cell(
        "proven",
        "bounded, the mean square of e of the order of Delta, for every Delta that is small enough; how small is not computed",
    )


def _linear(_: Problem, __: LinearFeedback, values: dict[str, Any]) -> tuple[str, dict[str, Cell]]:
    bounded = "error_bound" in values
    condition = values.get("condition")
    small_gain = "" if condition is None else f"||W_b S||_1 times the set's radius <= {up(condition['value_upper'])}"
    mu = values.get("mu_parameters")
    robustly = "" if mu is None else f"mu over the known set = {mu:.4g}, below 1 where every constant theta in it is stable"
    return "linear feedback", {
        "stability": Cell("proven" if bounded else "not proven", small_gain or "without a known set there is nothing to cover"),
        "tracking": Cell("not proven", "not to zero in general; to zero for a constant r where K(s) integrates"),
        "transient": Cell("proven", f"|e| <= {up(values['error_bound'])} at all times")
        if bounded
        else Cell("not proven", "no bound"),
        "estimates": Cell("estimate", "it estimates nothing"),
        "modelling_error": Cell("estimate", robustly or "see its margins"),
        "tuning": Cell("estimate", "no adaptive gain"),
        "margins": margins_cell(values),
    }


def _lyapunov_estimates(problem: Problem, controller: Mrac | L1Adaptive) -> Cell:
    if (void := laws.why_no_bound(controller, problem)) is not None:
        return Cell("not proven", f"bounded; {void}")
    convergence = "they converge to theta where the regressor is persistently exciting"
    if controller.learning is not None:
        convergence = "they converge to theta once the memory has seen every direction"
    return Cell("proven", f"theta_tilde'Gamma^-1 theta_tilde never exceeds its initial value; {convergence}")


def _unproven_robustness(problem: Problem, controller: Mrac | L1Adaptive) -> Cell:
    if controller.leakage is not None or controller.dead_zone is not None:
        return Cell("not proven", "bounded estimates; that x stays bounded is proven for bounded disturbances, not for Delta_m")
    kept = "projection keeps the estimates in the known set; " if _projected(problem, controller) else "the estimates may drift; "
    return Cell("not proven", kept + "that x stays bounded is not proven without normalisation")


def _projected(problem: Problem, controller: Mrac | L1Adaptive | NormalizedMrac | RobustMrac) -> bool:
    return problem.uncertainty is not None and controller.projection is not False


def limits_text(values: dict[str, Any]) -> str:
    """The numerics' limits, as far as there are any."""
    parts = []
    if values.get("gamma_max") is not None:
        parts.append(f"the solver at its step bears Gamma up to about {values['gamma_max']:.3g}")
    if values.get("step_max") is not None:
        parts.append(f"this gain bears a step up to about {values['step_max']:.3g} s")
    return "; ".join(parts) or "no limit of the step is known"


def margins_cell(values: dict[str, Any]) -> Cell:
    """Delay margins, at the case's theta and over the known set."""
    parts = []
    if "margins_of" in values:
        delay, which = values.get("delay_margin"), values["margins_of"].removeprefix("the linear loop ")
        parts.append(f"delay margin {'unlimited' if delay is None else f'{delay:.4g} s'} ({which})")
    for entry in values.get("margins_over_known_set", ()):
        which = entry["of"].removeprefix("the linear loop ")
        if "unstable_at" in entry:
            parts.append(f"over the known set unstable somewhere ({which})")
        elif "delay_margin" in entry:
            parts.append(f"over the known set {entry['delay_margin']['value']:.4g} s at the least found ({which})")
    if values.get("delay_margin_adapting") is not None:
        parts.append(f"linearised with its law at the largest command {values['delay_margin_adapting']:.3g} s")
    return Cell("estimate", "; ".join(parts) or "not known")


ANALYSES: dict[type, Analysis] = {
    Mrac: _mrac,
    L1Adaptive: _l1,
    NormalizedMrac: _normalized,
    RobustMrac: _normalized,
    LinearFeedback: _linear,
}
