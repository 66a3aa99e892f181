"""Certificates with the delays that the loops bear in simulation, beside the linear loops' exact margins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from barbalat.budget import Progress
from barbalat.certificates.certificate import Certificate, Draft
from barbalat.certificates.certificates import Certificates
from barbalat.loop.binding import numbered
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation
from barbalat.study.criteria import (
    EXAMINED,
    EXAMINED_WITHOUT_ESTIMATES,
    NOISE_SENTENCE,
    REST_SENTENCE,
    Lost,
    Onset,
    ReferenceMotion,
)
from barbalat.study.delay_margin import Bracket, DelayMargins, delay_margins
from barbalat.study.finer_step import PlainRun, delays_confirmed


def with_simulated_margins(
    certificates: Certificates,
    problem: TrackingProblem,
    controllers: Sequence[Controller],
    simulation: Simulation,
    *,
    lost: Lost | None = None,
    progress: Progress | None = None,
) -> Certificates:
    """The certificates with ``delay_onset_simulated`` and ``delay_margin_simulated`` [s], by ``Onset`` and by ``Lost``."""
    result, criterion = {}, lost or Lost()
    resting = (REST_SENTENCE,) if ReferenceMotion.of(problem, simulation).comes_to_rest else ()
    noisy = () if problem.noise is None else (NOISE_SENTENCE,)
    by_name = {one.name: one for one in numbered(controllers)}
    for name, found in delay_margins(problem, controllers, simulation, lost=criterion, progress=progress).items():
        controller = by_name[name]
        looked = _looked_at(problem, controller, simulation, found, criterion) if found.tracks[0] else ()
        disturbed = problem.disturbance is not None or bool(getattr(problem, "unmatched", ()))
        result[name] = _with(certificates[name], found, criterion, simulation, (*resting, *noisy, *looked), disturbed=disturbed)
    return certificates.with_changed(result)


def _with(
    certificate: Certificate,
    found: DelayMargins,
    lost: Lost,
    simulation: Simulation,
    beside: tuple[str, ...],
    *,
    disturbed: bool,
) -> Certificate:
    if not found.tracks[0]:
        return certificate.with_entries(certificate.entries, _not_tracking(found))
    onset = Onset()
    meanings = {
        "delay_onset_simulated": (
            found.onset,
            f"the loop is taken to oscillate when it is lost, when an estimate moves in the tail over more than {onset.share:g} "
            "of its known range, as fast as if it crossed that more often than the model crosses its own and "
            f"{onset.multiple:g} times as fast as without the delay, or when the error "
            f"has grown by {onset.share:g} of the largest |x_m| beyond what the delay adds where theta is known"
            f"{_begun(found, disturbed=disturbed)}{_driven(found, onset)}",
        ),
        "delay_margin_simulated": (
            found.loss,
            f"the loop is taken to be lost when the error in the tail has grown by {lost.share:g} times the largest |x_m| or it "
            f"diverged, so that a smaller oscillation is borne{'; with the measurement noise' if found.noisy else ''}",
        ),
    }
    measured = Draft()
    for key, (bracket, what) in meanings.items():
        rests_on = f"{key} was measured on the case's own run, no guarantee: {what}{_limit(bracket, simulation)}"
        measured.estimate({key: float(bracket.bears[0])}, rests_on, *beside)
    return certificate.with_entries((*certificate.entries, *measured.entries.values()))


def _looked_at(
    problem: TrackingProblem, controller: Controller, simulation: Simulation, found: DelayMargins, lost: Lost
) -> tuple[str, ...]:
    """Sentences: what is examined, what the run without a delay shows, whether a finer step says the same."""
    member = problem, controller
    (confirmed,) = delays_confirmed([member], simulation, found, numbers=np.zeros(1, dtype=int), criteria=(Onset(), lost))
    estimates = found.undelayed.theta_hat_final.shape[1] > 0
    examined = EXAMINED if estimates else EXAMINED_WITHOUT_ESTIMATES
    plain = PlainRun.of(*member, simulation)
    return (examined, *plain.sentences, *filter(None, [confirmed.sentence if plain.settles else None]))


def _begun(found: DelayMargins, *, disturbed: bool) -> str:
    """Why the onset lies at no delay."""
    if found.swings[0]:
        driven = ", be it that the disturbance drives them" if disturbed else ""
        return f"; its estimates oscillate without a delay already{', and without noise' if found.noisy else ''}{driven}"
    return "" if found.quiet_tracks[0] else "; without the noise it does not follow its model even without a delay"


def _driven(found: DelayMargins, onset: Onset) -> str:
    """What moves the estimates without a delay."""
    if not found.driven[0] or found.swings[0]:
        return ""
    return (
        "; its estimates move fast without a delay already, by the command or a disturbance: an oscillation that is slower than "
        f"{onset.multiple:g} times that is not seen in them"
    )


def _limit(bracket: Bracket, simulation: Simulation) -> str:
    """What the number alone does not say: that the search ended at its first or last delay."""
    if np.isinf(bracket.loses[0]):
        return "; it tolerates the longest delay that was tried"
    if bracket.bears[0] == 0 and bracket.loses[0] > 0:
        return f"; it does not tolerate even the shortest delay that can be simulated, two steps, {2 * simulation.dt:g} s"
    return ""


def _not_tracking(found: DelayMargins) -> str:
    diverged = found.undelayed.diverged_at[0]
    if np.isfinite(diverged):
        return f"no simulated delay margin: the loop diverges without a delay, at t = {diverged:.4g} s"
    error = float(found.undelayed.tail_max_abs_e[0].max())
    return (
        "no simulated delay margin: without a delay the loop does not follow its model, |e| in the tail reaches "
        f"{error:.4g}, more than the largest |x_m|"
    )
