"""Checks of settings that several schemes share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from barbalat import validate
from barbalat.adaptation.lyapunov import Modifications, ModifiedSettings
from barbalat.problem.known_set import EstimateSet, Gain, with_gains
from barbalat.problem.regressors import Linear
from barbalat.problem.state_feedback import Known
from barbalat.protocols import Controller
from barbalat.settings import Settings
from barbalat.validate import Array, InputError


class Scheme(Settings, Controller):
    """The base of the package's schemes; it lets type checkers accept a list of schemes as a list of controllers.

    beyond  names of ``PLANT_FEATURES`` that the scheme does not support: its ``bind`` calls ``require_taken``, and docs and
            schema show them
    """

    beyond: ClassVar[tuple[str, ...]] = ()


@runtime_checkable
class PatentNamed(Protocol):
    """A scheme whose law is claimed by a patent; users who export it are told."""

    @property
    def patent(self) -> str:
        """Sentences on the questions to clarify before flight."""
        ...


class Adaptive(Protocol):
    """Settings common to all adaptive controllers."""

    @property
    def name(self) -> str: ...

    @property
    def theta_hat0(self) -> Array | None: ...


class LyapunovSettings(Adaptive, ModifiedSettings, Protocol):
    """Settings of a scheme with a Lyapunov law that may be modified."""

    @property
    def gamma(self) -> float | Array: ...

    @property
    def projection(self) -> bool | None: ...


def check_common(settings: Adaptive) -> None:
    """Check the name, and the initial estimate if one is given."""
    validate.label("name", settings.name)
    if settings.theta_hat0 is not None:
        object.__setattr__(settings, "theta_hat0", validate.vector("theta_hat0", settings.theta_hat0))


def initial_estimate(theta_hat0: Array | None, estimate_set: EstimateSet | None, known: Known) -> Array:
    """theta_hat(0), (p,), inside the known set if there is one.

    The default is zero, or the centre of a set that does not contain zero; for an input gain, 1 or the nearest bound. With a
    baseline, the default is its theta_0 instead of zero, so the control starts as the baseline's.
    """
    gains = known.inputs if known.matched.gain_unknown else 0
    of_baseline = np.zeros(known.parameters - gains) if known.theta_0 is None else known.theta_0
    default = np.concatenate([of_baseline, np.ones(gains)])
    of_theta = None if estimate_set is None else estimate_set.of_theta(known.parameters - gains)
    if of_theta is not None and not of_theta.contains(default[: known.parameters - gains]):
        default[: known.parameters - gains] = of_theta.middle
    if known.gains is not None:
        default[-gains:] = np.clip(1.0, *known.gains.extent)
    if theta_hat0 is not None and gains and len(theta_hat0) == known.parameters - gains:
        theta_hat0 = np.concatenate([theta_hat0, default[-gains:]])
    estimate = default if theta_hat0 is None else validate.vector("theta_hat0", theta_hat0, known.parameters)
    estimate.flags.writeable = False
    if estimate_set is not None and not estimate_set.contains(estimate):
        raise InputError(f"theta_hat0 must lie in the known set, {estimate_set}, got {validate.show(estimate)}")
    return estimate


@dataclass(frozen=True)
class PlantFeature:
    """A feature of plants that not every scheme supports.

    found    whether a plant has it, from its known part
    refusal  the message after the name of a scheme that does not support it; {inputs} is the number of inputs
    others   the text after the names of the schemes that support it
    """

    found: Callable[[Known], bool]
    refusal: str
    others: str


PLANT_FEATURES = {
    "several inputs": PlantFeature(
        lambda known: known.inputs > 1, "supports only plants with one input, got {inputs}", "support several"
    ),
    "an unknown input gain": PlantFeature(
        lambda known: known.matched.gain_unknown, "takes the input gain as known", "support uncertainty.input_gain"
    ),
    "a baseline": PlantFeature(
        lambda known: known.theta_0 is not None,
        "cannot have a baseline, since none of its parts can be separated from a baseline",
        "support a baseline",
    ),
    "a regressor other than x": PlantFeature(
        lambda known: not isinstance(known.matched.regressor, Linear),
        "supports only the regressor phi(x) = x",
        "support others",
    ),
}
"""The plant features, by the names that schemes list in ``beyond``."""


def require_taken(scheme: type[Scheme], known: Known) -> None:
    """Raise InputError for a plant with a feature that the scheme does not support; the message lists schemes that support it."""
    from barbalat.controllers import SCHEMES  # imported here, because the registry imports this module

    for name in scheme.beyond:
        feature = PLANT_FEATURES[name]
        if feature.found(known):
            own = next((key for key, kind in SCHEMES.items() if issubclass(scheme, kind)), scheme.__name__)  # type: ignore[redundant-expr]
            taking = [key for key, kind in SCHEMES.items() if name not in beyond_of(kind)]
            refusing = [key for key in SCHEMES if key not in taking]
            others = _listed(taking) if len(taking) <= len(refusing) else f"all schemes but {_listed(refusing)}"
            raise InputError(f"{own} {feature.refusal.format(inputs=known.inputs)}; {others} {feature.others}")


def _listed(names: Sequence[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def beyond_of(scheme: type) -> tuple[str, ...]:
    """The plant features that a scheme declares as not supported; for a class from outside the package they are unknown until it
    is bound to a problem."""
    beyond: tuple[str, ...] = getattr(scheme, "beyond", ())
    return beyond


def bound_with_lyapunov_law(settings: LyapunovSettings, known: Known) -> dict[str, Any]:
    """The fields that the equations of L1-AC and MRAC share, for a plant. Raises InputError if the settings don't fit the
    plant."""
    gamma, modifications = Gain(settings.gamma), Modifications.of(settings)
    if known.theta_0 is not None:
        require_separable(modifications)
    gamma.require_size("gamma", known.parameters)
    modifications.require_fit(known.inputs)
    estimate_set = projection_set(settings.projection, known)
    return {
        "A_m": known.A_m,
        "b": known.b,
        "k_0": known.k_0,
        "P": known.P,
        "matched": known.matched,
        "gamma": gamma,
        "theta_hat0": initial_estimate(settings.theta_hat0, estimate_set, known),
        "x0": known.x0,
        "estimate_set": estimate_set,
        "modifications": modifications,
        "enters": known.enters,
    }


def require_separable(modifications: Modifications) -> None:
    """Raise InputError for modifications of a law that would treat the baseline as part of the learnt estimates."""
    if modifications.leakage is not None:
        raise InputError(
            "leakage pulls the estimates towards zero, and the baseline's gains with them: do not combine leakage with a baseline"
        )
    if modifications.learning is not None:
        raise InputError(
            "composite learning cannot be combined with a baseline: its memory assumes that only u and theta'phi drive the plant"
        )


def projection_set(projection: bool | None, known: Known) -> EstimateSet | None:
    """The set to project onto: by default the known set, if there is one; unknown input gains are always projected.

    The control is divided by their estimates, which must stay away from zero.
    """
    if projection is not None and not isinstance(projection, (bool, np.bool_)):
        raise InputError(f"projection must be true or false, got {validate.show(projection)}")
    nothing = known.estimate_set is None or not known.estimate_set.bounds_theta
    if projection and nothing:
        raise InputError(
            "projection needs the known set: give uncertainty.lower and .upper, or .center and .radius, or set projection = false"
        )
    return known.estimate_set if projection is None or projection else with_gains(None, known.gains)
