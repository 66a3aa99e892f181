"""The result of an identification: rows of coefficients, evidence on validation samples, findings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from barbalat.identify.alternative import Alternative
from barbalat.identify.known_set import Enclosure
from barbalat.identify.recording import CONSTANT, Recording
from barbalat.identify.validation import mean_interval
from barbalat.validate import Array

CONFIDENCE = 0.95
LEAST_FIT = 0.7
"""Smallest fit at which the ranges are accepted as describing a plant."""
CORRELATED = 0.3
"""Correlation of successive residuals at which the correct interval for a constant is 1.4 times as wide as for independent
errors."""
LEAST_PER_PERIOD = 4.0
"""Least number of samples in a period; with two or fewer, an oscillation has the same samples as a slower oscillation."""
NOISE_ALONE = 3.0
"""A residual on validation samples counts as noise up to this multiple of the fit's residual, because a restart amplifies its
initial error by e."""


@dataclass(frozen=True, eq=False)
class Row:
    """The result for the row of one state: the coefficients of the states, followed by those of the inputs.

    estimate, interval (p,), (p, 2)  of the output-error fit, with the confidence of ``CONFIDENCE``, infinite for a coefficient
                                     that the data do not excite; None for a given row
    nominal (p,)                     the fit, within the set's box or else ``limits`` if the free fit lies outside; a coefficient
                                     that the data do not excite starts in the middle of the box
    limits (p, 2)                    the bounds given by ``within``, infinite if there are none; None without ``within``
    enclosure                        contains every row that explains the data; None without noise bounds
    unexcited                        directions of coefficients, (p,) each, that the data do not distinguish
    """

    state: str
    nominal: Array
    estimate: Array | None = None
    interval: Array | None = None
    enclosure: Enclosure | None = None
    unexcited: tuple[Array, ...] = ()
    limits: Array | None = None

    @property
    def outside(self) -> bool:
        """Whether the fit lies outside the known set or the bounds of ``within``, in an excited coefficient."""
        box = self.ranges if self.enclosure is not None else self.limits
        if self.estimate is None or self.interval is None or box is None:
            return False
        beyond = (self.estimate < box[:, 0]) | (self.estimate > box[:, 1])
        return bool((beyond & np.isfinite(self.interval).all(axis=1)).any())

    @property
    def ranges(self) -> Array:
        """(p, 2) the box of the set, or else the confidence intervals within ``limits``, extended to contain the nominal row; for
        a given row, the row."""
        if self.enclosure is not None:
            return np.column_stack([self.enclosure.lower, self.enclosure.upper])
        if self.interval is None:
            return np.column_stack([self.nominal] * 2)
        if self.limits is None:
            return self.interval
        inside = np.clip(self.interval, self.limits[:, :1], self.limits[:, 1:])
        return np.column_stack([np.minimum(inside[:, 0], self.nominal), np.maximum(inside[:, 1], self.nominal)])


@dataclass(frozen=True, eq=False)
class Identification:
    """The result of ``identify``; ``case_text`` writes it as a case file.

    fit         keyed by state, on the validation samples: 1 - |y - simulated| / |y - mean|, with the nominal plant simulated from
                the initial state that fits these samples best; None if the simulation diverged
    restarted   an unstable nominal plant is simulated for at most this number of samples and then restarted from the measured
                state, so an error at the start grows by a factor of e at most; None if the simulation is never restarted
    held_fit    with restarts, the fit of a prediction that holds the measured state from one restart to the next
    predicted   (N, n), the nominal plant's states over the validation samples; at a restart the end of the earlier prediction
    held_factor keyed by state: the factor by which the error bounds would have to grow for the nominal plant to explain the
                validation windows; None without error bounds
    residual    keyed by state: RMS of the fit's residuals
    correlation keyed by state: the correlation of successive residuals
    reference   (n + m,) with an offset, the means of the samples used for the fit: the plant describes deviations from them, and
                the constant of a row is x' there; None without an offset
    delay       delay of all inputs [s]; ``recording`` contains the delayed inputs
    other       an offset or delay that explains the data better
    converged   whether the fit ended at a minimum
    """

    recording: Recording
    rows: tuple[Row, ...]
    noise: Mapping[str, float] | None
    slope: Mapping[str, float] | None
    trained: int
    predicted: Array
    fit: Mapping[str, float | None]
    held_factor: Mapping[str, float] | None
    restarted: int | None
    held_fit: Mapping[str, float] | None
    residual: Mapping[str, float]
    correlation: Mapping[str, float]
    reference: Array | None
    delay: float
    other: Alternative | None
    converged: bool

    @property
    def means(self) -> dict[str, float] | None:
        """With an offset, the means of the samples used for the fit, keyed by name; the constants of the rows are x' there."""
        names = (*self.recording.output_names, *self.recording.input_names)
        return None if self.reference is None else dict(zip(names, map(float, self.reference), strict=True))

    @property
    def operating_point(self) -> dict[str, float] | None:
        """With an offset, the equilibrium of the nominal plant, keyed by name; None without an offset, or if the plant has no
        equilibrium. Of several equilibria it is the one nearest to the means of the samples in terms of standard deviations."""
        if self.reference is None:
            return None
        names = (*self.recording.output_names, *self.recording.input_names)
        spread = np.maximum(np.column_stack([self.recording.outputs, self.recording.inputs]).std(axis=0), 1e-300)
        scaled, drift = np.column_stack([self.A, self.B]) * spread, np.array([row.nominal[-1] for row in self.rows])
        size = np.maximum(np.linalg.norm(scaled, axis=1), 1e-300)
        moved = -np.linalg.lstsq(scaled / size[:, None], drift / size, rcond=1e-9)[0]
        if not np.allclose(scaled @ moved, -drift, rtol=1e-6, atol=1e-9 * float(np.abs(scaled).max())):
            return None
        point = self.reference + spread * moved
        return dict(zip(names, map(float, np.where(np.abs(point) <= 1e-12 * spread, 0.0, point)), strict=True))

    @property
    def horizon(self) -> float | None:
        """The longest prediction between restarts [s], for the mean sampling interval; None without restarts."""
        return None if self.restarted is None else self.restarted * mean_interval(self.recording)

    @property
    def A(self) -> Array:
        """(n, n), nominal."""
        return np.array([row.nominal[: len(self.rows)] for row in self.rows])

    @property
    def B(self) -> Array:
        """(n, m), nominal."""
        n = len(self.rows)
        return np.array([row.nominal[n : n + len(self.recording.input_names)] for row in self.rows])

    @property
    def residuals(self) -> Array:
        """(N, n) measured minus simulated states over the validation samples; not finite if the nominal plant diverged."""
        with np.errstate(invalid="ignore", over="ignore"):
            return self.recording.outputs[len(self.recording.times) - len(self.predicted) :] - self.predicted

    @property
    def guaranteed(self) -> bool:
        """Whether the ranges contain every plant that explains the data: there are error bounds, and the set is bounded."""
        return self.noise is not None and all(np.isfinite(row.ranges).all() for row in self.rows)

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        return (*self.recording.output_names, *self.recording.input_names, *(() if self.reference is None else (CONSTANT,)))

    @property
    def findings(self) -> list[str]:
        """Findings to consider before using the results."""
        said = []
        for row in self.rows:
            for direction in row.unexcited:
                shares = {name: share for name, share in zip(self.coefficient_names, direction, strict=True) if abs(share) > 0.05}
                terms = [f"{share:+.2g} {name}" for name, share in shares.items()] if len(shares) > 1 else shares
                given = bool(np.isfinite(row.ranges[np.abs(direction) > 0.05]).all())
                instead = "its range is the one given by `within`" if given else "excite it, or bound it with `within`"
                said.append(
                    f"the data do not excite {' '.join(terms)} in the equation of {row.state}': that combination stays within "
                    f"its "
                    f"error in every window, so the data do not bound it; {instead}"
                )
            if not row.unexcited and not np.isfinite(row.ranges).all():
                said.append(
                    f"the known set of {row.state}' is not bounded: the bounds on noise and slope are too large for the motion; "
                    f"give smaller bounds, samples at shorter intervals or more motion, or bound it with `within`"
                )
            if row.outside:
                outside = "the known set" if row.enclosure is not None else "the bounds of `within`"
                said.append(f"the fit of {row.state}' lies outside {outside}: its nominal row is the best one inside")
            if row.enclosure is not None and not row.enclosure.exact:
                said.append(
                    f"the set of {row.state}' is a convex outer set: it has too many noisy regressors for a search by orthants"
                )
        if not self.converged:
            said.append("the fit's search did not end at a minimum, so do not trust its coefficients and intervals")
        if self.other is not None:
            said.append(self.other.sentence)
        where = "held-out samples" if self.trained < len(self.recording.times) else "samples"
        said += self._poor_predictions(where)
        least = max(CORRELATED, 5 / len(self.recording.times) ** 0.5)
        if follow := [name for name, value in self.correlation.items() if value > least]:
            largest = max(self.correlation[name] for name in follow)
            said.append(
                f"the residuals of {', '.join(follow)} are not noise: the correlation of successive residuals is {largest:.2g}, "
                f"because of a disturbance, dead time, nonlinearity or missing state; the intervals are too narrow"
            )
        fastest = float(np.abs(np.linalg.eigvals(self.A).imag).max()) * mean_interval(self.recording)
        if fastest > 2 * np.pi / LEAST_PER_PERIOD:
            said.append(
                f"a period of the nominal plant's fastest oscillation has only {2 * np.pi / fastest:.2g} samples, and a faster "
                "plant may give the same samples: sample at least twice as fast"
            )
        for name, factor in (self.held_factor or {}).items():
            if factor > 1:
                said.append(f"the nominal row of {name}' explains the {where} only with error bounds {factor:.3g} times larger")
        if self.noise is None:
            cut = "" if all(row.limits is None for row in self.rows) else ", cut to the bounds of `within`,"
            said.append(
                f"no noise bound is given: the ranges are {100 * CONFIDENCE:.0f} % confidence intervals{cut} "
                "and are not guaranteed"
            )
        return said

    def _poor_predictions(self, where: str) -> list[str]:
        """The states whose fit is poor: because they do not move, are noisy, or the plant is wrong."""
        rms = np.sqrt(np.mean(self.residuals**2, axis=0))
        moved = np.ptp(self.recording.outputs[len(self.recording.times) - len(self.predicted) :], axis=0)
        fits = {name: -np.inf if value is None else value for name, value in self.fit.items()}
        least = {name: max(LEAST_FIT, (self.held_fit or {}).get(name, 0.0)) for name in fits}
        still: list[str] = []
        noisy: list[str] = []
        wrong: list[str] = []
        for name, range_, value in zip(fits, moved, rms, strict=True):
            if range_ == 0:
                still.append(name)
            elif fits[name] < least[name]:
                white = self.correlation[name] <= CORRELATED
                (noisy if white and value <= NOISE_ALONE * self.residual[name] else wrong).append(name)
        said = []
        if still:
            said.append(f"the {where} contain no motion of {', '.join(still)}, so they validate nothing about it")
        if wrong:
            before = "" if self.horizon is None else f"over {self.horizon:.3g} s, "
            worse = ", ".join(name for name in wrong if fits[name] < (self.held_fit or {}).get(name, -np.inf))
            held = f", and predicts {worse} worse than holding the state from the last restart does" if worse else ""
            said.append(
                f"{before}the nominal plant does not explain the {where} (fit of {self._told(wrong)}; at least "
                f"{100 * LEAST_FIT:.0f} % is needed){held}. The ranges do not describe any real plant, so do not trust a "
                f"case file with them. Perhaps the outputs are not the whole state (encoders do not measure the rates, which are "
                f"also needed), or the plant is not linear or accumulates disturbances"
            )
        if noisy:
            said.append(
                f"the noise is large compared with the motion of {', '.join(noisy)} in the {where} (fit of {self._told(noisy)}): "
                "they validate little; record more motion"
            )
        return said

    def _told(self, names: Sequence[str]) -> str:
        """States with their fits."""
        fits = [(name, self.fit[name]) for name in names]
        return ", ".join(f"{name} {'none' if fit is None else f'{100 * fit:.1f} %'}" for name, fit in fits)

    def as_json(self) -> dict[str, Any]:
        """The document of ``identify --json``."""
        rows = {}
        for row in self.rows:
            ranges = [_ends(pair) for pair in row.ranges]
            rows[row.state] = {
                "nominal": dict(zip(self.coefficient_names, map(float, row.nominal), strict=True)),
                "known_set": dict(zip(self.coefficient_names, ranges, strict=True)) if self.noise is not None else None,
                "least_squares": None
                if row.estimate is None or row.interval is None
                else {
                    name: {"value": float(value), "interval": _ends(pair), "confidence": CONFIDENCE}
                    for name, value, pair in zip(self.coefficient_names, row.estimate, row.interval, strict=True)
                },
                "exact_set": None if row.enclosure is None else row.enclosure.exact,
                "given": row.estimate is None,
            }
        return {
            "samples": len(self.recording.times), "trained": self.trained, "rows": rows, "guaranteed": self.guaranteed,
            "noise": self.noise and dict(self.noise), "slope": self.slope and dict(self.slope),
            "held_out": {
                "fit": dict(self.fit), "error_factor": self.held_factor and dict(self.held_factor),
                "restart_every": self.restarted, "horizon": self.horizon,
                "fit_of_held_state": self.held_fit and dict(self.held_fit),
            },
            "delay": self.delay, "operating_point": self.operating_point, "means": self.means,
            "fit": {
                "residual_rms": dict(self.residual), "correlation": dict(self.correlation), "converged": self.converged,
            },
            "alternative": None if self.other is None else {
                "offset": self.other.offset, "delay": self.other.delay, "fit": self.other.fit,
                "instead_of": self.other.instead,
            },
            "residuals": self._residuals_as_json(),
            "findings": self.findings,
        }  # fmt: skip

    def _residuals_as_json(self) -> dict[str, Any]:
        """Measured minus simulated over the validation samples, with their RMS and largest value."""
        found: dict[str, Any] = {"t": self.recording.times[len(self.recording.times) - len(self.predicted) :].tolist()}
        for name, values in zip(self.recording.output_names, self.residuals.T, strict=True):
            bounded = bool(np.isfinite(values).all())
            found[name] = {
                "rms": float(np.sqrt(np.mean(values**2))) if bounded else None,
                "max_abs": float(np.abs(values).max()) if bounded else None,
                "values": [float(value) if np.isfinite(value) else None for value in values],
            }
        return found


def _ends(pair: Array) -> list[float | None]:
    """The ends of a range; None where it has no bound."""
    return [float(value) if np.isfinite(value) else None for value in pair]
