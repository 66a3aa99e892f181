"""Finds out whether a dead time or a constant term explains a recording better, by a scan over dead times with short fits."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from barbalat.identify import validation
from barbalat.identify.given import Structure
from barbalat.identify.output_error import Fit, refit
from barbalat.identify.recording import LEAST_SAMPLES, Recording
from barbalat.identify.windows import first_guess
from barbalat.validate import Array

MOST_DELAY = 0.2
"""Fraction of the samples for the fit up to which dead times are tried."""
SCAN_STEPS = 8
WORTH = 0.9
"""Largest residual on the validation samples, relative to the residual of the given model."""
LAGS = 8
WHITE = 0.15
"""If the correlations of the residuals at lags up to ``LAGS`` are below this, the residuals are noise that no model can
explain."""
ROUNDING = 1e-7
"""Fraction of a state's range below which its residuals are rounding errors."""
SPREAD = 4.0
"""Number of standard deviations of the correlation of noise."""
BETTER = 0.22
"""Gain of the log-likelihood per sample from which a term is worth reporting: the residual of one state is then 20 % smaller."""
SURE = 15.0
"""Gain of the log-likelihood below which chance may explain it."""


@dataclass(frozen=True)
class Alternative:
    """A different offset or delay [s], with the fits of the worst state on the validation samples, both with and without this
    change."""

    offset: bool
    delay: float | None
    fit: float
    instead: float

    @property
    def sentence(self) -> str:
        """A sentence on the options to try, and the reason."""
        terms = ["a constant term"] * self.offset + ([] if self.delay is None else [f"a dead time of {self.delay:g} s"])
        options = ["--offset"] * self.offset + ([] if self.delay is None else [f"--delay {self.delay:g}"])
        return (
            f"{' and '.join(terms)} {'explain' if len(terms) > 1 else 'explains'} the data better "
            f"(fit {100 * self.fit:.1f} % instead of {100 * self.instead:.1f} %): try {' '.join(options)}"
        )


def alternative(
    whole: Recording, structure: Structure, fitted: Fit, residual: Array, *, offset: bool, delay: float, trained: int
) -> Alternative | None:
    """The offset and delay that explain a recording clearly better than the given ones; None if there is nothing better.

    whole      recording without delay and in absolute values
    structure  structure of its coefficients without a constant term
    fitted     fit with the given offset and delay
    residual   (N, n) residual of that fit; if it is noise, nothing is tried
    trained    number of samples of ``whole`` that are not reserved for validation
    """
    if _is_noise(residual, fitted.simulated):
        return None
    scan = _Scan(whole, structure, fitted, delay, trained)
    now = (scan.steps_of(delay), offset)
    best = scan.best_delay(now[0])
    constants = (True,) if offset or structure.given.all() else (False, True)
    tried = sorted({now, (now[0], constants[-1]), (best, offset), (best, constants[-1])}, key=lambda one: (one != now, one[1]))
    losses = {one: scan.at(*one).loss for one in tried}
    margin = SURE + BETTER * scan.samples
    chosen = next(one for one in tried if losses[one] <= min(losses.values()) + margin)
    if chosen == now:
        return None
    fits = [scan.validated(*one) for one in (now, chosen)]
    if 1 - fits[1] > WORTH * (1 - fits[0]):
        return None
    steps, constant = chosen
    return Alternative(constant and not offset, steps * scan.interval if steps != now[0] else None, fits[1], fits[0])


def _is_noise(residual: Array, states: Array) -> bool:
    """Whether the residuals of each state are uncorrelated over a few samples, or rounding errors."""
    residual = residual[:, np.sqrt(np.mean(residual**2, axis=0)) > ROUNDING * np.ptp(states, axis=0)]
    power = np.maximum(np.sum(residual**2, axis=0), 1e-300)
    lags = range(1, min(LAGS, len(residual) - 1) + 1)
    largest = max(float(np.abs(np.sum(residual[k:] * residual[:-k], axis=0) / power).max(initial=0.0)) for k in lags)
    return largest <= max(WHITE, SPREAD / math.sqrt(len(residual)))


class _Scan:
    """Short fits of the same samples with dead times in steps, each with and without a constant term."""

    def __init__(self, whole: Recording, structure: Structure, fitted: Fit, delay: float, trained: int) -> None:
        self.whole, self.plain, self.trained = whole, structure, trained
        self.interval = whole.sample_time or 0.0
        self.most = max(int(MOST_DELAY * trained), self.steps_of(delay)) if self.interval else 0
        self.samples = trained - self.most
        self.length = min(fitted.length, self.samples)
        self.near = fitted.matrix[:, : structure.start.shape[1]]
        self.found: dict[tuple[int, bool], Fit] = {}

    def steps_of(self, delay: float) -> int:
        return round(delay / self.interval) if delay else 0

    def model(self, steps: int, constant: bool, stop: int) -> tuple[Recording, Structure]:
        """The samples that all dead times have in common, up to ``stop`` of the whole recording."""
        recording = self.whole.shifted(steps).part(self.most - steps, stop - steps)
        if not constant:
            return recording, self.plain
        reference = np.column_stack([recording.outputs, recording.inputs])[: self.samples].mean(axis=0)
        return recording.about(reference), self.plain.about(reference)

    def at(self, steps: int, constant: bool) -> Fit:
        """The fit for a dead time."""
        if (steps, constant) not in self.found:
            recording, structure = self.model(steps, constant, self.trained)
            near = structure.start.copy()
            near[:, : self.near.shape[1]] = self.near
            guess = [first_guess(recording, i, *row) for i, row in enumerate(zip(structure.start, structure.free, strict=True))]
            self.found[steps, constant] = refit(recording, (near, np.array(guess)), structure.free, self.length, steps=SCAN_STEPS)
        return self.found[steps, constant]

    def best_delay(self, now: int) -> int:
        """The best number of steps: the best of a grid whose distances grow, refined by halving distances."""
        grid = sorted(
            {now, *(2**k for k in range(self.most.bit_length())), *(3 * 2**k for k in range(self.most.bit_length()))} | {0}
        )
        grid = [steps for steps in grid if steps <= self.most]
        constant = not self.plain.given.all()

        def loss(steps: int) -> float:
            return self.at(steps, constant).loss

        best = min(grid, key=loss)
        reach = max(best // 4, 1)
        while reach:
            nearer = min((best, max(best - reach, 0), min(best + reach, self.most)), key=loss)
            if nearer == best:
                reach //= 2
            best = nearer
        return best

    def validated(self, steps: int, constant: bool) -> float:
        """The fit of the worst state on the samples after those used for fitting, or on all samples if there are too few; -inf if
        a state diverges."""
        recording, _ = self.model(steps, constant, len(self.whole.times))
        rest = (
            recording.part(self.samples, len(recording.times))
            if len(recording.times) - self.samples >= LEAST_SAMPLES
            else recording
        )
        matrix = self.at(steps, constant).matrix
        fits = validation.fits(rest, validation.predicted(matrix, rest, validation.restart_every(matrix, rest)))
        return min(-np.inf if fit is None else fit for fit in fits.values())
