"""The second term of (17), which is the effect of a modelling error on the robust MRAC's error at a fixed tau.

The command contains two frequencies. With only one frequency, two estimates can match the plant with its modelling error exactly
at that frequency, and the term vanishes. Delta_2 is the L1 norm of Delta(s) = W_m Delta_m for Delta_m = -mu s. It also bounds the
norm for an input delay mu and for -mu s/(T s + 1), because (1 - e^(-mu s))/(mu s) and 1/(T s + 1) have the L1 norm 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from barbalat.adaptation.law import Normalization
from barbalat.controllers import RobustMrac
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.systems import TransferFunction
from barbalat.papers.claim import Claim, Listing, Measurement, span, table
from barbalat.papers.finding import PROPORTIONAL_SHARE, Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import figures, local_exponents, variant
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.papers.jafari_2013.statements import MENDED
from barbalat.problem.actuation import PlantInput
from barbalat.problem.modelling_error import DelayError, ModellingError, ScaledError
from barbalat.protocols import Signal
from barbalat.signals import Sine, Sines
from barbalat.validate import Array

TAUS = np.array([0.5, 0.25, 0.125, 0.0625])
"""Values of tau [s]: Section V's value, and the results of halving it once, twice and three times."""
SIZES = np.array([0.002, 0.004, 0.008, 0.016, 0.032])
"""Values of mu, or of the delay [s], up to half of the smallest tau. The robust MRAC tolerates every pair."""
STEP = 1e-3
"""Step [s], a sixtieth of the smallest tau."""
T_END, LONGER_T_END = 200.0, 800.0
"""Horizons [s] without and with ``--full``. The last quarter of the shorter run contains four periods of the slower
sine."""
COMMAND, ONE_SINE = Sines((30.0, 20.0), (0.5, 1.7)), Sine(50.0, 0.5)
DERIVATIVE_POLE = 2e-3
"""Time constant of the realisation of -mu s [s], as in the rows on Theorem 2's boundary."""
DELTA_0, ALPHA_0 = 0.5, 0.05
"""Constants of (16). With them 1/delta_0 = 2 s exceeds every tau, Delta(s) is analytic to the right of -0.25, and n_d is at most
a third of phi'phi."""


def families() -> dict[str, ModellingError]:
    """Return the two modelling errors that the paper names."""
    derivative = ScaledError(TransferFunction([-1.0, 0.0], [DERIVATIVE_POLE, 1.0]))
    return {"Delta_m = -mu s/(0.002 s + 1)": derivative, "input delay": DelayError()}


@dataclass(frozen=True, eq=False)
class Errors:
    """The largest |e| of the run and of its last quarter over TAUS and SIZES, (4, 5) each, and the same two without Delta, (4,)
    each."""

    peak: Array
    tail: Array
    peak_without: Array
    tail_without: Array

    @property
    def exponents(self) -> Array:
        """The local exponents (4, 4) of the tail's error in the size, at fixed tau."""
        return np.array([local_exponents(row, SIZES) for row in self.tail])

    @property
    def slopes(self) -> Array:
        """The tail's error per second of mu (4,), at the largest size."""
        return np.asarray(self.tail[:, -1] / SIZES[-1])


def controller(tau: float, alpha_0: float) -> RobustMrac:
    """Return Figure 2's robust MRAC with the dynamic normalising signal of (16). In Section V alpha_0 is 0."""
    return replace(section_v.robust_mrac("r", tau), normalization=Normalization(alpha_0=alpha_0, delta_0=DELTA_0))


def measure(error: ModellingError, alpha_0: float, t_end: float, command: Signal = COMMAND) -> Errors:
    """Simulate all pairs of tau and size, and every tau without modelling error."""
    paths = [error.added(PlantInput(), float(size)) for size in SIZES]
    pairs = [(variant(input=path, reference=command), controller(float(tau), alpha_0)) for tau in TAUS for path in paths]
    given = figures(pairs, t_end, STEP)
    without = figures([(variant(reference=command), controller(float(tau), alpha_0)) for tau in TAUS], t_end, STEP)
    shape = (len(TAUS), len(SIZES))
    return Errors(
        peak=given.max_abs_e.max(axis=1).reshape(shape),
        tail=given.tail_max_abs_e.max(axis=1).reshape(shape),
        peak_without=without.max_abs_e.max(axis=1),
        tail_without=without.tail_max_abs_e.max(axis=1),
    )


def norm_per_size() -> float:
    """Return Delta_2 per second of mu, which is ||s W_m||_1 rounded up, with s W_m = c_0'A_m (sI - A_m)^-1 b + c_0'b."""
    known, c_0 = section_v.problem().known, np.array(section_v.C_0)
    return l1_norm(known.A_m, known.b[:, None], (c_0 @ known.A_m)[None], np.array([[c_0 @ known.b]])).upper


def constants(errors: Errors) -> Array:
    """Return for each tau (4,) the smallest nu with |e| <= (tau + Delta_2) nu, over all sizes and without modelling error."""
    delta_2 = norm_per_size() * np.append(0.0, SIZES)
    return np.asarray((np.column_stack([errors.peak_without, errors.peak]) / (TAUS[:, None] + delta_2)).max(axis=1))


def claim(*, full: bool = False) -> Claim:
    """Measure the exponent of the remaining error in the size of Delta, and whether one nu suffices for all tau and sizes."""
    t_end = LONGER_T_END if full else T_END
    found = {
        f"{name}, alpha_0 = {alpha_0:g}": measure(error, alpha_0, t_end)
        for name, error in families().items()
        for alpha_0 in (0.0, ALPHA_0)
    }
    exponents = np.concatenate([errors.exponents.ravel() for errors in found.values()])
    nu = np.array([constants(errors) for errors in found.values()])
    with_tau = np.array([np.polyfit(np.log(TAUS), np.log(errors.slopes), 1)[0] for errors in found.values()])
    readings = _one_constant(nu), _proportional(found), _peak(found)
    return Claim(
        sentence=SENTENCES["delta-2-term"],
        readings=readings,
        shows=f"One nu = {nu.max():.3g} is sufficient for every tau and size tried; the smallest nu falls to "
        f"{nu[:, -1].max():.3g} as tau falls to {TAUS[-1]:g} s.",
        measured=        f"the remaining |e| at fixed tau varies as mu^{exponents.min():.3f} to mu^{exponents.max():.3f}; one "
        f"nu = {nu.max():.3g} is sufficient for every run, with Delta_2 = {norm_per_size():.3g} mu. {_of_tau(found, with_tau)}. "
        f"With the command of Section V, a single sine, {_one_frequency()}",
        how=f"Section V with r = 30 sin 0.5t + 20 sin 1.7t, robust MRAC, {MENDED}, RK4, h = {STEP:g} s, {t_end:g} s, tau = "
        f"{span(TAUS)} s, mu = {span(SIZES)} s, as Delta_m = -mu s and as a delay; with Section V's alpha_0 = 0 and with (16), "
        f"alpha_0 = {ALPHA_0:g}, delta_0 = {DELTA_0:g}; errors are taken over every step, and the tail is the last quarter",
        listings=_listings(found, nu),
        would_change="fails: a nu that grows as tau falls, or an unbounded run",
        sharpened=f"runs of {LONGER_T_END:g} s, in which learning has further reduced the remaining error",
    )  # fmt: skip


def _one_constant(nu: Array) -> Reading:
    return SENTENCES["delta-2-term"].reads(
        bool(np.isfinite(nu).all() and (nu[:, -1] <= nu[:, :-1].max(axis=1)).all()),
        f"the smallest nu is {nu[:, 0].max():.3g} for tau = {TAUS[0]:g} s and {nu[:, -1].max():.3g} for {TAUS[-1]:g} s",
    )


def _proportional(found: dict[str, Errors]) -> Reading:
    ratios = np.concatenate([(errors.tail[:, 1:] / errors.tail[:, :-1]).ravel() for errors in found.values()])
    return Reading(
        "the error that remains at fixed tau is proportional to Delta_2",
        bool((np.abs(ratios / 2 - 1) < PROPORTIONAL_SHARE).all()),
        f"in {ratios.size} pairs, doubling the size multiplies the error by {span(ratios)}",
        "beside",
    )


def _of_tau(found: dict[str, Errors], with_tau: Array) -> str:
    """Return a sentence on how the term depends on tau. (17) is only a bound, so the term need not shrink with tau, but it
    does."""
    slopes = next(iter(found.values())).slopes
    return (
        f"The remaining error per mu is {slopes[0]:.3g} 1/s for tau = {TAUS[0]:g} s and {slopes[-1]:.3g} 1/s for {TAUS[-1]:g} s"
        f"; it also varies with tau, as tau^{with_tau.min():.2f} to tau^{with_tau.max():.2f}"
    )


def _one_frequency() -> str:
    """Return a sentence on a command of one frequency, at which two estimates fit a delayed plant."""
    tails = [_one_sine(t_end) for t_end in (T_END, LONGER_T_END)]
    return (
        f"|e| in the tail with tau = {TAUS[0]:g} s and a delay of {SIZES[-1]:g} s is {tails[0]:.3g} after {T_END:g} s and "
        f"{tails[1]:.3g} after {LONGER_T_END:g} s"
    )


def _one_sine(t_end: float) -> float:
    given = variant(input=PlantInput(delay=float(SIZES[-1])), reference=ONE_SINE)
    return float(figures([(given, controller(float(TAUS[0]), 0.0))], t_end, STEP).tail_max_abs_e.max())


def _peak(found: dict[str, Errors]) -> Reading:
    """Return the reading on the transient, which is longer and larger if Delta is near its limit."""
    errors = next(iter(found.values()))
    exponents = np.array([local_exponents(row, SIZES) for row in errors.peak - errors.peak_without[:, None]])
    return Reading(
        "the peak of the transient also grows in proportion to Delta_2, up to the largest Delta that is tolerated",
        bool((np.abs(2.0 ** (exponents - 1) - 1) < PROPORTIONAL_SHARE).all()),
        f"the part of the largest |e| due to mu varies as mu to the power {span(exponents[0])} at tau = {TAUS[0]:g} s and "
        f"{span(exponents[-1])} at {TAUS[-1]:g} s",
        "beside",
    )  # fmt: skip


def _listings(found: dict[str, Errors], nu: Array) -> tuple[Listing, ...]:
    """Return tables with a row for each size and a column for each tau, and a table with the values behind the first two
    readings."""
    by_size = [
        table(
            f"{name}: the largest |e| of {part}, by tau [s] and by mu or the delay [s]",
            {"mu [s]": np.append(0.0, SIZES)}
            | {f"tau = {tau:g}": np.append(*of_tau) for tau, *of_tau in zip(TAUS, without, errors, strict=True)},
        )
        for name, each in found.items()
        for part, without, errors in (
            ("the run", each.peak_without, each.peak),
            ("the last quarter", each.tail_without, each.tail),
        )
    ]
    slopes = np.array([errors.slopes for errors in found.values()])
    by_tau = table(
        "The smallest nu in |e| <= (tau + Delta_2) nu, and the remaining |e| per second of mu [1/s]; both are the "
        "largest over the modelling errors",
        {"tau [s]": TAUS, "nu": nu.max(axis=0), "tail's |e| per mu": slopes.max(axis=0)},
    )
    return *by_size, by_tau


ROWS = (
    Measurement(
        claim,
        2.0,
        {"delta-2-term": "the effect of a modelling error on the robust MRAC's error at a fixed tau"},
        place=290,
        sharper=partial(claim, full=True),
        sharper_seconds=3.5,
    ),
)
