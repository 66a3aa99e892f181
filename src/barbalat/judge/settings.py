"""What a run is judged by: bands in the plant's units, given or derived from the model's motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from barbalat import validate
from barbalat.problem.tracking import TrackingProblem
from barbalat.settings import Settings, one_line
from barbalat.validate import Array, InputError

FOLLOWS_SHARE = 0.05
"""The default band of the tail's error, as a part of a component's scale."""
LOST_SHARE = 100.0
"""A component beyond so many times its scale is lost by default: 40 dB above all that was asked for."""
CYCLE_SHARE = 0.025
"""Of the control's range. On the flexible joint, with noise, every hysteresis from 1 to 5 % separates cycles from the rest."""
ROUNDING = 1e-9
"""A model's component that moves by less than this part of the largest one rests; what is seen of it are roundings."""


@dataclass(frozen=True, kw_only=True)
class Judge(Settings):
    """What counts as following, as lost, and as a limit cycle; nothing needs to be given.

    follows  by components, the largest |error| of the tail with which a run follows, in the plant's units; 5 % of the component's
             scale unless given. The scale is the model's largest motion; where the model rests, the initial state, else the noise
    lost     by components, the magnitude beyond which a run is lost, in the plant's units; 100 times the scale unless given
    cycle    the hysteresis of a reversal of the limited control and the least swing of a limit cycle, as a share of the control's
             range: of its limits, or of what it covers where there are none
    closely  looks for a limit cycle in every run, also where the control reverses too seldom in the tail to be suspected, since
             the tail may be shorter than one and a half periods. It takes up to three and a half times the run more
    """

    follows: Mapping[str, float] = field(default_factory=dict)
    lost: Mapping[str, float] = field(default_factory=dict)
    cycle: float = CYCLE_SHARE
    closely: bool = False

    __repr__ = one_line

    def __post_init__(self) -> None:
        for name in ("follows", "lost"):
            given = getattr(self, name)
            if not isinstance(given, Mapping):
                raise InputError.of(f"judge.{name}", f"must give bands by components, got {validate.show(given)}")
            bands = {str(key): validate.positive(f"judge.{name}.{key}", value) for key, value in given.items()}
            object.__setattr__(self, name, bands)
        share = validate.positive("judge.cycle", self.cycle)
        if share >= 1:
            raise InputError.of("judge.cycle", f"must be a share of the control's range below 1, got {share:g}")
        object.__setattr__(self, "cycle", share)
        if not isinstance(self.closely, (bool, np.bool_)):
            raise InputError.of("judge.closely", f"must be true or false, got {validate.show(self.closely)}")
        object.__setattr__(self, "closely", bool(self.closely))

    def require(self, problem: TrackingProblem) -> None:
        """InputError for a component that the problem does not have."""
        names = component_names(problem)
        for bands in ("follows", "lost"):
            for key in getattr(self, bands):
                if key not in names:
                    raise InputError.of(f"judge.{bands}.{key}", f"names no component; there are {', '.join(names)}")

    def bands(self, names: tuple[str, ...], units: tuple[str, ...], scale: Array) -> Bands:
        """Of components with these names and units; ``scale`` (..., n)."""
        given = [
            np.array([found.get(name, np.nan) for name in names]) * np.ones_like(scale) for found in (self.follows, self.lost)
        ]
        defaults = FOLLOWS_SHARE * scale, LOST_SHARE * scale
        follows, lost = (np.where(np.isnan(own), usual, own) for own, usual in zip(given, defaults, strict=True))
        return Bands(names, units, scale, follows, lost)


@dataclass(frozen=True, eq=False)
class Bands:
    """The bands of n components in the plant's units; each array is (..., n).

    scale    of each component
    follows  within which the tail's error follows
    lost     beyond which the run is lost
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: Array
    follows: Array
    lost: Array

    def said(self, i: int) -> str:
        """Of the i-th run: "theta follows within 0.025 rad and is lost beyond 50 rad; ..."."""
        each = zip(self.names, self.units, self.follows[i], self.lost[i], strict=True)
        return "; ".join(
            f"{name} follows within {follows:.3g}{_unit(unit)} and is lost beyond {lost:.3g}{_unit(unit)}"
            for name, unit, follows, lost in each
        )


def _unit(bracketed: str) -> str:
    return f" {bracketed[1:-1]}" if bracketed else ""


def component_names(problem: TrackingProblem) -> tuple[str, ...]:
    """What the components of the error are called: by the labels, else x_1, x_2, ..., or y."""
    return problem.measured_names


def scale_of(model: Array, initial: Array, noise: Array | None, reached: Array) -> Array:
    """The scale of each component, (M, n).

    The largest |y_m| of the run; where the model rests, |y| at t = 0, else the noise's standard deviation, else the largest |y|
    itself: what a disturbance did before it was rejected.
    """
    found = np.where(model > ROUNDING * model.max(axis=-1, keepdims=True, initial=0.0), model, 0.0)
    for other in (np.abs(initial), 0.0 * found if noise is None else noise, reached):
        found = np.where(found > 0, found, other)
    return np.asarray(found)
