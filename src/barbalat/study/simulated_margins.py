"""Adds the simulated margins of a case to its certificates. They include limits, commands and noise, which the margins of linear
loops ignore."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from barbalat.budget import Progress, part_of
from barbalat.certificates.certificate import Certificate, Draft, Simulated
from barbalat.certificates.certificates import Certificates
from barbalat.judge.settings import Judge
from barbalat.loop.binding import numbered
from barbalat.problem.modelling_error import GainError
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import (
    LARGEST_GAIN_ERROR,
    LONGEST_DELAY,
    DelayMargins,
    delay_margins,
    gains_scanned,
    longest_delay,
    margins_ensemble,
)
from barbalat.study.finer_step import PlainRun, delays_confirmed, gains_confirmed
from barbalat.study.ideal_benchmark import NOISE_SENTENCE, SHORTEST_DELAY_STEPS, Ideals, Judging
from barbalat.study.reference_motion import REST_SENTENCE, ReferenceMotion
from barbalat.study.resolved import resolved
from barbalat.study.verdicts import Lost

MEASURED_SENTENCE = (
    "measured by simulating this case with its limits and commands and is not a guarantee. The margin ends when the judge finds "
    "the run lost or in a limit cycle, or when an oscillation grows throughout the observed time"
)
FILLED_SENTENCE = (
    "even without a delay, the noise drives one of its estimates from end to end of the known set in the last quarter"
)
PARTS = 3
"""Number of searches for each controller: the delay, the gain upwards and the gain downwards."""


def with_simulated_margins(
    certificates: Certificates,
    problem: TrackingProblem,
    controllers: Sequence[Controller],
    simulation: Simulation,
    *,
    judge: Judge | None = None,
    lost: Lost | None = None,
    progress: Progress | None = None,
) -> Certificates:
    """Return the certificates with ``delay_margin_measured`` [s] and ``gain_margin_measured``, and the simulations behind them.

    The certificates also have ``delay_onset_simulated``, the older name of the measured delay margin, and
    ``delay_margin_simulated`` [s], by ``Lost``.
    """
    result, by = {}, Judging(judge or Judge(), lost or Lost())
    given, simulation = numbered(controllers), resolved(problem, controllers, simulation)
    for i, controller in enumerate(given):
        part = part_of(progress, i / len(given), 1 / len(given))
        found = _Measured.of(problem, controller, simulation, by, part)
        result[controller.name] = found.on(certificates[controller.name], problem, simulation)
    return certificates.with_changed(result)


@dataclass(frozen=True, eq=False)
class _Measured:
    """The measurements of one controller: margins, the run without a modelling error, and the check by a finer step."""

    controller: Controller
    by: Judging
    delay: DelayMargins
    gains: tuple[DelayMargins, DelayMargins]
    plain: PlainRun
    confirmed: str | None
    gains_confirmed: tuple[str, ...]

    @classmethod
    def of(
        cls,
        problem: TrackingProblem,
        controller: Controller,
        simulation: Simulation,
        by: Judging,
        progress: Progress | None,
    ) -> _Measured:
        member, zero = (problem, controller), np.zeros(1, dtype=int)
        part = part_of(progress, 0.0, 1 / PARTS)
        delay = delay_margins(problem, [controller], simulation, judge=by.judge, lost=by.lost, progress=part)[controller.name]
        gains, sizes, errors = [], gains_scanned(), [GainError(downwards) for downwards in (False, True)]
        for k, error in enumerate(errors, start=1):
            ideals, part = Ideals(simulation, sizes, error), part_of(progress, k / PARTS, 1 / PARTS)
            gains.append(margins_ensemble([member], simulation, sizes, ideals, by=by, progress=part))
        plain, confirmed, of_gains = PlainRun.of(problem, controller, simulation, by.judge), None, []
        if delay.tracks[0] and plain.settles:
            confirmed = delays_confirmed([member], simulation, delay, numbers=zero, by=by)[0].sentence
            for found, error in zip(gains, errors, strict=True):
                of_gains += gains_confirmed([member], simulation, found, error, numbers=zero, by=by)
        said = [one.sentence for one in of_gains if one.changes] or [one.sentence for one in of_gains]
        return cls(controller, by, delay, (gains[0], gains[1]), plain, confirmed, tuple(dict.fromkeys(filter(None, said))))

    @property
    def gain(self) -> float:
        """The factor by which the input's effectiveness may be multiplied and divided."""
        return 1 + float(min(one.onset.tolerates[0] for one in self.gains))

    def on(self, certificate: Certificate, problem: TrackingProblem, simulation: Simulation) -> Certificate:
        """The certificate with these measurements."""
        said, verdict = f"{_run_of(problem, simulation)}: {self.plain.verdict}", self.plain.verdict.as_json()
        notes = [FILLED_SENTENCE] if self.delay.noisy and self.delay.fills[0] else []
        if not self.delay.tracks[0]:
            simulated = Simulated(said, verdict, "no margin: it does not track its model without a delay")
            return certificate.with_simulated(simulated).with_entries(certificate.entries, *notes, _not_tracking(self.delay))
        simulated = Simulated(said, verdict, self._in_words(simulation))
        entries = (*self._entries(problem, simulation).entries.values(), *certificate.entries)
        return certificate.with_simulated(simulated).with_entries(
            entries, *notes, *self._compared_with_linear(certificate, longest_delay(simulation))
        )

    def _entries(self, problem: TrackingProblem, simulation: Simulation) -> Draft:
        resting = (REST_SENTENCE,) if ReferenceMotion.of(problem, simulation).comes_to_rest else ()
        noisy = (NOISE_SENTENCE,) if self.delay.noisy else ()
        plain = (*resting, *noisy, *self.plain.sentences)
        beside = (*plain, *filter(None, [self.confirmed]))
        onset, begun = float(self.delay.onset.tolerates[0]), self._begun
        limit = _limit(self.delay.onset.tolerates[0], self.delay.onset.loses[0], simulation)
        loss = (
            f"delay_margin_simulated was measured by simulating this case and is not a guarantee. The loop counts as lost if "
            f"the judge finds it lost or if the tail error grows by {self.by.lost.share:g} times the largest |x_m|; a smaller "
            f"oscillation is tolerated{'. The margin holds both with and without measurement noise' if self.delay.noisy else ''}"
            f"{_limit(self.delay.loss.tolerates[0], self.delay.loss.loses[0], simulation)}"
        )
        drawn = Draft()
        delay = f"delay_margin_measured was {MEASURED_SENTENCE}{begun}{limit}"
        drawn.estimate({"delay_margin_measured": onset}, delay, *beside)
        drawn.estimate(
            {"gain_margin_measured": self.gain},
            f"gain_margin_measured was {MEASURED_SENTENCE}{begun}",
            *plain,
            *self.gains_confirmed,
        )
        drawn.estimate({"delay_onset_simulated": onset}, delay, *beside)
        drawn.estimate({"delay_margin_simulated": float(self.delay.loss.tolerates[0])}, loss, *beside)
        return drawn

    @property
    def _begun(self) -> str:
        """The reason why the margin is zero."""
        return ". The loop already oscillates without a delay and without noise" if self.delay.oscillates[0] else ""

    def _in_words(self, simulation: Simulation) -> str:
        if self.delay.oscillates[0]:
            return "none: even without a delay it is in a limit cycle, or its oscillation grows"
        delay, loses = float(self.delay.onset.tolerates[0]), float(self.delay.onset.loses[0])
        longest = " at least" if np.isinf(loses) else ""
        tolerated = (
            f"delay{longest} {delay:.3g} s" if delay > 0 else f"delay below {SHORTEST_DELAY_STEPS * simulation.resolution:.3g} s"
        )
        all_gains = all(np.isinf(one.onset.loses[0]) for one in self.gains)
        ends = self.delay.ends[0]
        first = min(self.gains, key=lambda one: float(one.onset.tolerates[0])).ends[0]
        return f"{tolerated}{_until(ends)}, gain{' at least' * all_gains} {self.gain:.3g}{_until(first)}"

    def _compared_with_linear(self, certificate: Certificate, longest: float) -> list[str]:
        """Findings if the linear loop tolerates more than twice as much as the case."""
        values, delay = certificate.values, float(self.delay.onset.tolerates[0])
        keys = [key for key in ("delay_margin", "delay_margin_adapting") if key in values]
        larger = [f"{key}, {_of_linear(values[key])}" for key in keys if less_than_half(delay, values[key], longest)]
        said = [half_sentence(f"delay margin, {delay:.3g} s", larger)] if larger else []
        up, down = values.get("gain_margin"), values.get("gain_reduction_margin")
        known = "gain_margin" in values and "gain_reduction_margin" in values  # None: no gain destabilises the linear loop
        linear = min(up or np.inf, 1 / down if down else np.inf)
        if known and linear > 1 and less_than_half(np.log(self.gain), np.log(min(linear, 1 + LARGEST_GAIN_ERROR)), np.inf):
            said.append(
                half_sentence(
                    f"gain margin, {self.gain:.3g}",
                    [f"gain_margin, {'any gain' if np.isinf(linear) else f'{linear:.3g}'}"],
                    ", in decibels",
                )
            )
        lost = float(self.delay.loss.loses[0])
        if lost <= delay:
            said.append(
                f"the loop counts as lost no later than it oscillates: from a delay of {lost:.3g} s on, the error in the tail "
                f"has grown by {self.by.lost.share:g} times the largest |x_m| (delay_margin_simulated)"
            )
        return said


def _until(ends: str) -> str:
    return f" until {ends}" if ends else ""


def less_than_half(measured: float, linear: float | None, largest: float = LONGEST_DELAY) -> bool:
    """Whether a margin, measured up to ``largest``, is less than half the margin of a linear loop; None means an infinite
    margin."""
    return measured < 0.5 * (largest if linear is None else min(linear, largest))


def half_sentence(measured: str, linear: Sequence[str], scale: str = "") -> str:
    """The finding that a measured margin is less than half of the linear margins."""
    theirs = "that of the linear loop" if len(linear) == 1 else "those of the linear loops"
    return f"the measured {measured}, is less than half of {theirs} without limits{scale}: {'; '.join(linear)}"


def _of_linear(value: float | None) -> str:
    return "any delay" if value is None else f"{value:.3g} s"


def _run_of(problem: TrackingProblem, simulation: Simulation) -> str:
    """A few words on the simulation."""
    commands = ", ".join(dict.fromkeys(type(one).__name__.lower() for one in problem.commands))
    around = problem.surroundings
    parts = [f"this case simulated for {simulation.t_end:g} s, {commands} command"]
    if any(path.saturation is not None or path.rate_limit is not None for path in around.paths):
        parts.append("with the input's limits")
    if problem.delay > 0:
        parts.append(f"its delay of {problem.delay:g} s")
    if around.disturbance is not None or around.unmatched:
        parts.append("its disturbances")
    if problem.faults:
        parts.append("its faults")
    if problem.noise is not None:
        parts.append("judged without its noise and again with it; the verdict shown is the one without noise")
    stepped = f"{simulation.solver.name}, {simulation.step}" if simulation.tolerance is None else simulation.how
    return f"{', '.join(parts)}; {stepped}"


def _limit(tolerates: float, loses: float, simulation: Simulation) -> str:
    """The remark that the search ended at its first or last delay."""
    if np.isinf(loses):
        return ". The loop tolerates the longest delay that was tried"
    if tolerates == 0 and loses > 0:
        steps, shortest = "two steps, " * (simulation.tolerance is None), SHORTEST_DELAY_STEPS * simulation.resolution
        return f". The loop does not tolerate even the shortest delay that can be simulated, {steps}{shortest:g} s"
    return ""


def _not_tracking(found: DelayMargins) -> str:
    diverged = found.undelayed.diverged_at[0]
    if np.isfinite(diverged):
        return f"no simulated delay margin: the loop diverges without a delay, at t = {diverged:.4g} s"
    error = float(found.undelayed.tail_max_abs_e[0].max())
    return (
        f"no simulated delay margin: without a delay the loop does not track its model: |e| in the tail reaches {error:.4g}, "
        f"more than the motion of the model in every component"
    )
