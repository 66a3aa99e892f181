"""The judge's settings, with bands, in the plant's units, that are given or derived from the motion of the model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from barbalat import validate
from barbalat.judge.verdict import FOLLOWS_SHARE
from barbalat.problem.tracking import TrackingProblem
from barbalat.settings import Settings, one_line
from barbalat.validate import Array, InputError

LOST_SHARE = 100.0
"""Multiple of its scale beyond which a component is lost by default: 40 dB above everything that was commanded."""
CYCLE_SHARE = 0.025
"""Default hysteresis as a fraction of the control's range. On the flexible joint with noise, every hysteresis from 1 to 5 %
separates cycles from other runs."""


@dataclass(frozen=True, kw_only=True)
class Judge(Settings):
    """The criteria for the verdicts *follows*, *lost* and *limit cycle*; all have defaults.

    follows  by component, the largest |error| in the tail up to which a run counts as following, in the plant's units. Every
             component is judged: one without a value has 5 % of its scale, and a very large value excludes a component. The scale
             is the model's largest motion; if the model is at rest, the largest of initial state, noise and the model's response
             to the disturbances
    lost     by component, the magnitude beyond which a run is lost, in the plant's units; 100 times the scale by default
    cycle    the hysteresis of a reversal of the limited control and the smallest swing of a limit cycle, as a fraction of the
             control's range. The range is that between its limits or, without limits, the one that it covers
    closely  examine every run for a limit cycle, even if the control reverses too rarely in the tail to be suspected. The tail
             may then be shorter than one and a half periods. This takes up to three and a half times as long as the run, in
             addition to the run
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
                raise InputError.of(f"judge.{name}", f"must give a band for each named component, got {validate.show(given)}")
            bands = {str(key): validate.positive(f"judge.{name}.{key}", value) for key, value in given.items()}
            object.__setattr__(self, name, bands)
        share = validate.positive("judge.cycle", self.cycle)
        if share >= 1:
            raise InputError.of("judge.cycle", f"must be a fraction of the control's range below 1, got {share:g}")
        object.__setattr__(self, "cycle", share)
        if not isinstance(self.closely, (bool, np.bool_)):
            raise InputError.of("judge.closely", f"must be true or false, got {validate.show(self.closely)}")
        object.__setattr__(self, "closely", bool(self.closely))

    def named(self, problem: TrackingProblem) -> Judge:
        """Return these settings with each band under the label of its component. Raises InputError for a component that the
        problem does not have.

        Components may be named by their labels, or as x_1, x_2, ..., or y with output feedback.
        """
        names = component_names(problem)
        numbered = tuple(f"x_{i + 1}" for i in range(len(names))) if problem.feedback == "state" else ("y",)
        also = {other: name for other, name in zip(numbered, names, strict=True) if other not in names}
        found: dict[str, dict[str, float]] = {"follows": {}, "lost": {}}
        for bands, by_name in found.items():
            for key, value in getattr(self, bands).items():
                name = also.get(key, key)
                if name not in names:
                    raise InputError.of(
                        f"judge.{bands}.{key}", f"does not name a component; the components are {', '.join(names)}"
                    )
                if name in by_name:
                    raise InputError.of(f"judge.{bands}.{key}", f"is a second band of {name}; give only one")
                by_name[name] = value
        return replace(self, follows=found["follows"], lost=found["lost"])

    def bands(self, names: tuple[str, ...], units: tuple[str, ...], scale: Array, declared: tuple[int, ...] = ()) -> Bands:
        """Return the bands for components with these names and units. ``scale`` is (..., n), and ``declared`` as in ``Bands``."""
        given = [
            np.array([found.get(name, np.nan) for name in names]) * np.ones_like(scale) for found in (self.follows, self.lost)
        ]
        defaults = FOLLOWS_SHARE * scale, np.where(scale > 0, LOST_SHARE * scale, np.inf)
        follows, lost = (np.where(np.isnan(own), usual, own) for own, usual in zip(given, defaults, strict=True))
        return Bands(names, units, scale, follows, lost, declared)


@dataclass(frozen=True, eq=False)
class Bands:
    """The bands of n components in the plant's units; each array is (..., n).

    scale     the scale of each component
    follows   bands for the tail's error within which a run follows
    lost      magnitudes beyond which a run is lost
    declared  numbers of the components that are declared to follow a command, which verdicts name first
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: Array
    follows: Array
    lost: Array
    declared: tuple[int, ...] = ()

    def said(self, i: int) -> str:
        """Return the text on the bands of the i-th run: "theta follows within 0.025 rad and is lost beyond 50 rad; ..."."""
        each = zip(self.names, self.units, self.follows[i], self.lost[i], strict=True)
        return "; ".join(
            f"{name} follows within {follows:.3g}{_unit(unit)} and "
            + (f"is lost beyond {lost:.3g}{_unit(unit)}" if np.isfinite(lost) else "has no scale, so no size counts as lost")
            for name, unit, follows, lost in each
        )


def _unit(bracketed: str) -> str:
    return f" {bracketed[1:-1]}" if bracketed else ""


def component_names(problem: TrackingProblem) -> tuple[str, ...]:
    """Return the names of the components of the error: their labels, or x_1, x_2, ..., or y."""
    return problem.followed_names
