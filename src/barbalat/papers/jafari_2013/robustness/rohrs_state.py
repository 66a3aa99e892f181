"""Rohrs' plant as one with a measured state: x' = -x + 2 v behind 229/(s^2 + 30 s + 229), under the projected (3)-(4) and (5)-(8).

His model -3 x_m + 3 r makes it x' = -3 x + 2 (theta x + v) with theta = 1 and k_0 = 1.5. With theta_hat at rest the loop is
(s + 1)(s^2 + 30 s + 229) + 458 C theta_hat: stable between -0.5 and 17.03 without filter.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from barbalat.controllers import L1Adaptive, Mrac
from barbalat.linear.largest import largest
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.papers.claim import Listing, Reading, verdict
from barbalat.papers.jafari_2013.variants import figures
from barbalat.papers.wording import table
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.plant import Plant, ReferenceModel
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller, Signal
from barbalat.signals import Constant, Sines
from barbalat.validate import Array

UNMODELLED = TransferFunction([229.0], [1.0, 30.0, 229.0])
COMMANDS: dict[str, Signal] = {"r = 0.3 + 1.85 sin 16.1t": Sines((1.85,), (16.1,), constant=0.3), "r = 2": Constant(2.0)}
GAINS = (1.0, 10.0, 100.0, 1000.0)
WIDE_BOUND, NARROW_BOUND = 20.0, 5.0
"""Known sets |theta| <= 20, which holds gains that the plant does not bear, and |theta| <= 5."""
KAPPAS = (0.02, 0.1)
"""Section V's filter, and one of about a third of the plant's own bandwidth."""
T_END, STEP = 200.0, 1e-3
"""[s]: two hundred time constants of the plant; h times the unmodelled modes' 15 rad/s is 0.015."""


def problem(width: float, command: Signal) -> Problem:
    """The plant with the known set |theta| <= width."""
    return Problem(
        plant=Plant(A_m=[[-3.0]], b=[2.0], theta=[1.0], input=PlantInput(actuator=UNMODELLED)),
        reference_model=ReferenceModel(k_0=1.5),
        reference=command,
        uncertainty=ParameterBox(lower=[-width], upper=[width]),
    )


def scheme(kappa: float | None, gamma: float) -> Controller:
    """MRAC, or L1-AC with the first-order filter."""
    return Mrac(gamma=gamma) if kappa is None else L1Adaptive(gamma=gamma, filter=input_filter(kappa))


def diverged_at(kappa: float | None, command: Signal) -> Array:
    """(2, gains) when the run diverged [s], NaN where it did not, with the wide known set and the narrow one."""
    pairs = [(problem(width, command), scheme(kappa, gamma)) for width in (WIDE_BOUND, NARROW_BOUND) for gamma in GAINS]
    return np.asarray(figures(pairs, T_END, STEP).diverged_at.reshape(2, -1))


def largest_gain(kappa: float | None) -> float:
    """The largest theta_hat that the frozen loop bears, by its characteristic roots."""
    nominal = (
        np.polymul([1.0, 1.0], UNMODELLED.den)
        if kappa is None
        else np.polymul(np.polymul([1.0, 1.0], UNMODELLED.den), [kappa, 1.0])
    )

    def is_stable(gain: float) -> bool:
        return bool(np.roots(np.polyadd(nominal, [2.0 * 229.0 * gain])).real.max() < 0)

    return largest(is_stable, 1e-3, 1e3, within=1e-10)


def beside_rohrs() -> tuple[tuple[Reading, ...], Listing]:
    """With a known set that holds gains the plant does not bear, and with one that does not; when each run is lost."""
    at = {kappa: {name: diverged_at(kappa, command) for name, command in COMMANDS.items()} for kappa in (None, *KAPPAS)}
    wide = {kappa: np.array([each[0] for each in found.values()]) for kappa, found in at.items()}
    narrow = {kappa: np.array([each[1] for each in found.values()]) for kappa, found in at.items()}
    lost, kept = partial(_text, wide), KAPPAS[1]
    readings = (
        Reading(
            "they can diverge on Rohrs' plant too (not named by the paper), |theta| <= 20",
            verdict(holds=bool(np.isfinite(wide[None]).any() and np.isfinite(wide[KAPPAS[0]]).any())),
            f"{lost(None)}; {lost(KAPPAS[0])}; the frozen loops bear theta_hat up to {largest_gain(None):.3g} and {largest_gain(KAPPAS[0]):.3g}; with |theta| <= {NARROW_BOUND:g} "
            f"{sum(int(np.isfinite(each).sum()) for each in narrow.values())} of {sum(each.size for each in narrow.values())} runs diverge",
        ),
        Reading(
            "... there L1-AC with any filter",
            verdict(holds=bool(np.isfinite(wide[kept]).any())),
            f"{lost(kept)}: over these runs the slower filter keeps it bounded where MRAC is lost",
        ),
    )  # fmt: skip
    return readings, _listing(at)


def _listing(at: dict[float | None, dict[str, Array]]) -> Listing:
    """A row for each scheme and known set."""
    earliest = {kappa: np.fmin(*found.values()) for kappa, found in at.items()}  # NaN where no command's run is lost
    schemes: dict[str, Sequence[str] | Array] = {
        "scheme": [_name(kappa) for kappa in at for _ in (WIDE_BOUND, NARROW_BOUND)],
        "known set": [f"|theta| <= {width:g}" for width in (WIDE_BOUND, NARROW_BOUND)] * len(at),
    }
    by_gain = {f"Gamma = {gain:g}": np.concatenate([found[:, i] for found in earliest.values()]) for i, gain in enumerate(GAINS)}
    return table(
        f"Rohrs' plant: when the first of the runs with {len(COMMANDS)} commands diverges [s], of {T_END:g} s; -: none does",
        schemes | by_gain,
    )


def _name(kappa: float | None) -> str:
    return "MRAC" if kappa is None else f"L1-AC, kappa = {kappa:g} s"


def _text(wide: dict[float | None, Array], kappa: float | None) -> str:
    """At which gains the runs are lost, for either command."""
    gone = np.isfinite(wide[kappa]).any(axis=0)
    tried = f"of the {len(GAINS)} gains from {GAINS[0]:g} to {GAINS[-1]:g}"
    if not gone.any():
        return f"{_name(kappa)} diverges with none {tried}"
    return f"{_name(kappa)} diverges with {gone.sum()} {tried}, first at {np.nanmin(wide[kappa]):.3g} s"
