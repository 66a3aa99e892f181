"""Differences between a controller's keys and the fields of its settings, and its builder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from barbalat.adaptation.law import OutputErrorLaw
from barbalat.adaptation.laws import Gradient
from barbalat.cases.keys import Context, Differences, Given, Key, keys_of
from barbalat.controllers import L1Adaptive, L1PiecewiseConstant, LinearFeedback, NormalizedMrac, Sampled
from barbalat.controllers.output import L1Output, L1OutputPiecewiseConstant, LinearOutput, MracOutput
from barbalat.controllers.output.l1 import fast_limit, linear_equivalent
from barbalat.controllers.sampled import DISCRETIZATIONS
from barbalat.design import delay_weight, hinf_feedback, mixed_sensitivity, pi_controller, pi_feedback
from barbalat.linear.systems import TransferFunction, input_filter, strictly_proper
from barbalat.validate import Array, InputError

SAMPLING = keys_of(Sampled, Differences(optional=("sample_time",), without=("controller",)))
SAMPLING["discretization"] = SAMPLING["discretization"]._replace(type=Literal[DISCRETIZATIONS])
"""The keys with which any controller runs in sampled form, as it would on a flight computer."""


def sampling_of(keys: Mapping[str, Key]) -> dict[str, Key]:
    """Return a scheme's keys for sampling; none if it is always sampled and has a sample time of its own."""
    common = SAMPLING["sample_time"]
    return SAMPLING if keys.get("sample_time", common) is common else {}


@dataclass(frozen=True)
class LowPass:
    """filter = { kappa }, { kappa, order } or { num, den }."""


def _low_pass(given: Given, _: Context) -> TransferFunction | None:
    """C(s); None for C = 1."""
    if "kappa" in given:
        if given.keys() - {"kappa", "order"}:
            raise InputError("give either kappa or num and den")
        return None if given["kappa"] == 0 else input_filter(**given)
    if given.keys() != {"num", "den"}:
        raise InputError("give kappa, or both num and den")
    return TransferFunction(**given)


def _normalized(given: Given, _: Context) -> NormalizedMrac:
    if ("law" in given) == ("gamma" in given):
        raise InputError("give either gamma, for the gradient law, or law")
    if "gamma" in given:
        given["law"] = Gradient(gamma=given.pop("gamma"))
    return NormalizedMrac(**given)


def _linear(given: Given, context: Context) -> LinearFeedback:
    """The given controller, or one designed for the known part of the problem."""
    controller, design, delay, bandwidth = (
        given.pop(key, None) for key in ("controller", "design", "unmodelled_delay", "bandwidth")
    )
    if (controller is None) == (design is None):
        raise InputError('give either controller = { num, den } or design = "hinf" or "pi"')
    if bandwidth is not None and design != "hinf":
        raise InputError('bandwidth needs design = "hinf"')
    if controller is not None:
        return LinearFeedback(controller=controller, unmodelled=None if delay is None else delay_weight(delay), **given)
    if design == "pi":
        return pi_feedback(context.known, unmodelled_delay=delay, **given)
    return hinf_feedback(context.known, unmodelled_delay=delay, bandwidth=bandwidth, **given)


def _mrac_output(given: Given, _: Context) -> MracOutput:
    projection, known_set = given.pop("projection", None), ("lower", "upper", "c_0_min")
    unnormalized = isinstance(given["law"], OutputErrorLaw)
    if unnormalized and "normalization" in given:
        raise InputError('normalization needs a law on the parametric model; law.kind = "lyapunov" is unnormalised')
    if projection and not any(key in given for key in known_set):
        raise InputError("projection needs lower and upper, or c_0_min")
    if projection is False and not unnormalized:
        raise InputError(
            "projection must stay on for a law on the parametric model"
            ", because it keeps c_0 away from zero; if only c_0_min is given, nothing else is projected"
        )
    without = known_set if projection is False else ()
    return MracOutput(**{key: value for key, value in given.items() if key not in without})


def _l1_output(given: Given, _: Context) -> L1Output:
    projection = given.pop("projection", None)
    if projection and "sigma_bound" not in given:
        raise InputError("projection needs sigma_bound")
    if projection is False:
        given.pop("sigma_bound", None)
    return L1Output(**given)


def _linear_output(given: Given, context: Context) -> LinearOutput:
    if "equivalent_of" in given:
        return _equivalent(given, context)
    if given.pop("limit", False):
        raise InputError("limit needs equivalent_of")
    if ("controller" in given) == ("design" in given):
        raise InputError('give either controller = { num, den } or design = "hinf" or "pi"')
    if "design" in given:
        return _designed(given, context)
    if given.keys() & {"design_plant", "unmodelled_delay", "bandwidth"}:
        raise InputError("design_plant, unmodelled_delay and bandwidth need design")
    return LinearOutput(loop=given.pop("controller"), **given)


def _designed(given: Given, context: Context) -> LinearOutput:
    design, delay, bandwidth, model = (
        given.pop(key, None) for key in ("design", "unmodelled_delay", "bandwidth", "design_plant")
    )
    if delay is None:
        raise InputError(f'unmodelled_delay is missing; design = "{design}" needs it')
    if "feedforward" in given:
        raise InputError("feedforward needs controller")
    model = context.known.plant if model is None else strictly_proper("design_plant", model)
    if design == "hinf":
        return LinearOutput(loop=mixed_sensitivity(model, delay, bandwidth).controller.transfer_function(), **given)
    if bandwidth is not None:
        raise InputError('bandwidth needs design = "hinf"')
    return LinearOutput(loop=pi_controller(model, delay), **given)


def _equivalent(given: Given, context: Context) -> LinearOutput:
    """The linear equivalent, inside the bounds of sigma, of one of the case's l1-output controllers; with ``limit``, for gamma ->
    infinity."""
    name, limit = given.pop("equivalent_of"), given.pop("limit", False)
    if further := given.keys() - {"name"}:
        raise InputError(f"{min(further)} cannot be combined with equivalent_of")
    others = context.others(L1Output)
    if name not in others:
        known = ", ".join(repr(other) for other in others) or "none"
        raise InputError(f"equivalent_of must name an l1-output controller of this case ({known}), got {name!r}")
    same = (fast_limit if limit else linear_equivalent)(others[name]())
    return LinearOutput(loop=same.feedback, feedforward=same.feedforward, **given)


_DESIGN = {
    "controller": Key(TransferFunction, "K(s), proper; or a design", None),
    "design": Key(Literal["hinf", "pi"], "designs K(s) for `unmodelled_delay`; `hinf` requires `barbalat[robust]`", None),
    "unmodelled_delay": Key(float, "the delay [s] that the loop must tolerate at the plant's input", None),
    "bandwidth": Key(
        float, "[rad/s] of the `hinf` design; by default 0.9 times the largest bandwidth that the delay allows", None
    ),
}

DIFFERENCES: dict[type, Differences] = {
    L1Adaptive: Differences(keys={"filter": Key(LowPass, "C(s): stable, strictly proper, C(0) = 1; starts at rest")}),
    L1PiecewiseConstant: Differences(keys={"filter": Key(LowPass, "C(s): as for `l1`, by the trapezoidal rule")}),
    L1OutputPiecewiseConstant: Differences(
        keys={"filter": Key(LowPass, "C(s): stable, C(0) = 1, of at least the model's relative degree; by the trapezoidal rule")}
    ),
    LowPass: Differences(
        keys={
            "kappa": Key(float, "C(s) = 1/(kappa s + 1) [s]; 0 means C = 1", None),
            "order": Key(int, "C(s) = 1/(kappa s + 1)^order; 1 by default", None),
            **{name: key._replace(default=None) for name, key in keys_of(TransferFunction, Differences()).items()},
        },
        make=_low_pass,
    ),
    NormalizedMrac: Differences(
        keys={"gamma": Key(float | Array, "instead of `law`: the gain of the gradient law", None)},
        optional=("law",),
        make=_normalized,
    ),
    LinearFeedback: Differences(keys=_DESIGN, without=("unmodelled",), make=_linear),
    MracOutput: Differences(
        keys={"projection": Key(bool | None, "projection onto the known set; on by default if there is one", None)},
        make=_mrac_output,
    ),
    L1Output: Differences(
        keys={
            "projection": Key(bool | None, "projection onto |sigma| <= sigma_bound; on by default if sigma_bound is given", None)
        },
        make=_l1_output,
    ),
    LinearOutput: Differences(
        keys={
            **_DESIGN,
            "design_plant": Key(TransferFunction, "G(s) that the design assumes; the plant by default", None),
            "equivalent_of": Key(
                str, "the name of the `l1-output` controller to which this one is equivalent inside its bounds", None
            ),
            "limit": Key(bool, "with `equivalent_of`: the limit of that controller for gamma -> infinity", False),
        },
        without=("loop",),
        make=_linear_output,
    ),
}
