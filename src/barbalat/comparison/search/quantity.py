"""The quantities of a tuning: metrics of its runs, tolerated delays in simulation, and values of its certificate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import Enum
from math import inf

import numpy as np

from barbalat import validate
from barbalat.certificates.certificate import Certificate
from barbalat.certificates.quantities import EACH_INPUT
from barbalat.problem.modelling_error import DelayError, GainError, ModellingError
from barbalat.run.kernel.metrics import Metrics
from barbalat.study.verdicts import Criterion
from barbalat.sweeps.requirement import Requirement
from barbalat.validate import Array, InputError

FIGURE_NAMES = tuple(field.name for field in fields(Metrics) if field.name != "diverged_at")


@dataclass(frozen=True)
class Probe:
    """A quantity from runs with a modelling error. If there are several errors, the least tolerated one counts.

    none  the value that means no error, from which the size is measured
    """

    errors: tuple[ModellingError, ...]
    criterion: Criterion
    none: float


_GAINS = (GainError(), GainError(downwards=True))
PROBES = {
    "delay_margin_measured": Probe((DelayError(),), Criterion.ONSET, 0.0),
    "gain_margin_measured": Probe(_GAINS, Criterion.ONSET, 1.0),
    "delay_onset_simulated": Probe((DelayError(),), Criterion.ONSET, 0.0),
    "delay_margin_simulated": Probe((DelayError(),), Criterion.LOSS, 0.0),
    "gain_onset_simulated": Probe(_GAINS, Criterion.ONSET, 1.0),
    "gain_margin_simulated": Probe(_GAINS, Criterion.LOSS, 1.0),
}
"""Margins by the keys of ``certify --simulate``: delays [s], and factors by which the input's effectiveness may be
multiplied and divided."""


OF_A_LINEAR_LOOP = frozenset(
    [*EACH_INPUT, *EACH_INPUT.values(), "delay_margin_adapting", "complementary_sensitivity_peak", "margins_over_known_set"]
)
LINEAR_DELAYS = ("delay_margin", "delay_margin_each", "delay_margin_adapting")
"""The delay margins among these margins."""
LINEAR_SENTENCE = (
    "{key} belongs to a linear loop without input limits, rate limits, quantisation or a changing command, any of which may "
    "cause a limit cycle at a much smaller delay. delay_margin_measured is found by simulating the loop in motion"
)


class Origin(Enum):
    """How a value is found, from the cheapest way to the most expensive."""

    RUN = "run"
    CERTIFICATE = "certificate"
    PROBE = "runs with a modelling error"


@dataclass(frozen=True)
class TunedQuantity:
    """A metric of ``run --json``, with an index or for all components, or a key of ``certify --json``.

    larger_is_worse  whether the largest value of several components or plants, or of an enclosure, counts
    """

    name: str
    larger_is_worse: bool

    def __post_init__(self) -> None:
        if not self.name:
            raise InputError(f"a quantity must be a metric ({', '.join(FIGURE_NAMES)}) or a key of certify, got ''")

    @property
    def origin(self) -> Origin:
        if self.name in PROBES:
            return Origin.PROBE
        return Origin.RUN if self.name.split("[")[0] in FIGURE_NAMES else Origin.CERTIFICATE

    @property
    def key(self) -> str:
        """The key of a certificate that contains the quantity, alone or as a part."""
        return self.name.partition(".")[0]

    @property
    def errors(self) -> tuple[ModellingError, ...]:
        """The modelling errors of the runs that are needed to find the quantity."""
        return PROBES[self.name].errors if self.name in PROBES else ()

    @property
    def worst(self) -> float:
        return inf if self.larger_is_worse else -inf

    def of_runs(self, metrics: Metrics) -> Array:
        """Return the quantity of M runs (M,).

        If there are several components, the value is that of the worst one, or, for ``rms_e``, the root of the sum of their
        squares. A run that diverged has the worst value.
        """
        columns = metrics.columns()
        if self.name in columns:
            found = columns[self.name]
        else:
            parts = [values for name, values in columns.items() if name.split("[")[0] == self.name]
            if not parts:
                known = [name for name in columns if name.split("[")[0] == self.name.split("[")[0]]
                raise InputError(
                    f"{self.name} is not a metric of this case; choose one of {', '.join(known) or ', '.join(columns)}"
                )
            found = self._together(np.array(parts))
        return np.where(np.isnan(found), self.worst, found)

    def _together(self, parts: Array) -> Array:
        if self.name == "rms_e":
            return np.asarray(np.sqrt((parts**2).sum(axis=0)))
        return np.asarray(parts.max(axis=0) if self.larger_is_worse else parts.min(axis=0))

    def over_plants(self, values: Array, quantile: float) -> Array:
        """Return, from values (K, P), the value (K,) that a fraction ``quantile`` of the plants keeps; for 1 it is the value of
        the worst plant."""
        ordered = np.sort(values, axis=1) if self.larger_is_worse else -np.sort(-values, axis=1)
        place = max(int(np.ceil(quantile * values.shape[1])) - 1, 0)
        return np.asarray(ordered[:, place])

    def of_certificate(self, certificate: Certificate) -> float | None:
        """Return the value if the certificate claims it for this case: for an enclosure its relevant side, for several inputs the
        worst."""
        key, part = self.key, self.name.partition(".")[2]
        values = certificate.values
        if key in values.get("unlimited", ()):
            return inf
        found = values.get(key)
        if part and isinstance(found, dict):
            found = found.get(part)
        if isinstance(found, dict):
            side = "upper" if self.larger_is_worse else "lower"
            found = found.get(side, found.get("value_upper") if self.larger_is_worse else None)
        if key in EACH_INPUT.values() and isinstance(found, list):
            found = (max if self.larger_is_worse else min)(inf if one is None else one for one in found)
        return float(found) if isinstance(found, (int, float)) and not isinstance(found, bool) else None

    def require_known(self, certificates: Mapping[str, Certificate]) -> None:
        """Raise InputError if one of the controllers' certificates for the unchanged case has no such key."""
        having = [name for name, one in certificates.items() if one.entry(self.key) is not None]
        lacking = [name for name in certificates if name not in having]
        if having and lacking:
            raise InputError(
                f"certify reports {validate.show(self.key)} only for {_listed(having)}, not for {_listed(lacking)}"
                ": use --controller to select the controller to tune"
            )
        if lacking:
            known = (*FIGURE_NAMES, *PROBES, *(entry.key for one in certificates.values() for entry in one.entries))
            raise InputError(
                f"{validate.show(self.name)} is neither a metric of run --json, such as rms_e, nor one of {', '.join(PROBES)}, "
                f"nor a key of certify --json for {_listed(lacking)}{validate.hint(self.name, known)}"
            )


def _listed(names: list[str]) -> str:
    return ", ".join(map(validate.show, names))


@dataclass(frozen=True)
class Constraint:
    """A requirement of a tuning."""

    requirement: Requirement
    quantity: TunedQuantity

    @classmethod
    def parse(cls, text: str) -> Constraint:
        """Parse a requirement. Raises InputError for an invalid text, or for a requirement that a search cannot satisfy."""
        requirement = Requirement.parse(text)
        quantity = TunedQuantity(requirement.figure, larger_is_worse=requirement.sign.startswith("<"))
        if quantity.origin is Origin.PROBE:
            least = PROBES[quantity.name].none
            if quantity.larger_is_worse or requirement.limit <= least:
                what, example = ("delay", "0.01") if least == 0 else ("factor", "2")
                raise InputError(
                    f"{quantity.name} needs a lower limit on the {what} above {least:g}, such as {quantity.name} >= "
                    f"{example}, got {text!r}"
                )
        return cls(requirement, quantity)

    def holds(self, value: float | None) -> bool:
        return value is not None and not self.requirement.broken(np.array(value))

    def violation(self, value: float | None) -> float:
        """Return 0 if the constraint holds, otherwise its violation relative to both numbers, at most 1; 1 without a value."""
        if self.holds(value):
            return 0.0
        if value is None or not np.isfinite(value):
            return 1.0
        limit = self.requirement.limit
        size = abs(value) + abs(limit)
        return 0.5 * abs(value - limit) / size if size else 0.0
