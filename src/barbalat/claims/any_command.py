"""Theorems 1 (i) and 2 without modelling error: e -> 0 for any bounded command; here many, of seven kinds, drawn at random."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from barbalat.claims import section_v
from barbalat.claims.claim import Claim, Listing, Reading, of_readings, verdict
from barbalat.claims.variants import span, variant
from barbalat.controllers import Mrac
from barbalat.protocols import Controller, Signal
from barbalat.run.ensemble import simulate_ensemble
from barbalat.signals import Chirp, Constant, Recorded, Sines, Square, Steps
from barbalat.solvers.simulation import Simulation
from barbalat.study.motion import Motion
from barbalat.validate import Array

SEED = 20130820  # any fixed number: the draws are the same on every machine
DRAWS, MORE_DRAWS = 2, 12
"""Of each kind, by the plain command and by ``--full``."""
LARGEST_COMMAND = 50.0
"""|r| of Section V."""
T_END, LONGER = 400.0, 1600.0
H = 2e-3
"""20 times below what the fastest dynamics, those of tau, need for RK4's fourth order to show; jumps are met exactly."""
MRAC_GAIN, MRAC_STEP = 0.01, 5e-3
"""Of the standard MRAC: slow enough for a first quarter in which there is an error to fall from, and h omega_a = 0.35 at |x| = 50."""
FALL_OF_MRAC = 0.1
"""The last quarter's largest error over the first's. Its error has no rate: where rare jumps excite anew it may rise in between."""
SMALL_ERROR_SHARE = 1e-3
"""Of the largest |x_m|: what counts as close to zero at the end."""
ONE_OVER_T = 1 / 3
"""The start of the second quarter over that of the last."""
NOISE_STEP = 0.05
"""Between the samples of the noise, which is straight in between [s]."""


def sums_of_sines(rng: np.random.Generator, _: float) -> Signal:
    """Two to six of them, over two decades of frequency."""
    count = int(rng.integers(2, 7))
    shares = rng.dirichlet(np.ones(count))
    return Sines(tuple(LARGEST_COMMAND * shares), tuple(10 ** rng.uniform(-1, 1, count)), tuple(rng.uniform(0, 2 * np.pi, count)))


def square_wave(rng: np.random.Generator, _: float) -> Signal:
    """Half periods of 1.5 s to 30 s."""
    return Square(LARGEST_COMMAND, float(10 ** rng.uniform(-1, 0.3)), phase=float(rng.uniform(0, 2 * np.pi)))


def chirp(rng: np.random.Generator, t_end: float) -> Signal:
    """Over the whole run, up to 1 to 100 rad/s."""
    return Chirp(LARGEST_COMMAND, float(rng.uniform(0.02, 0.5)), float(10 ** rng.uniform(0, 2)), t_end)


def filtered_noise(rng: np.random.Generator, t_end: float) -> Signal:
    """White noise behind a first-order lag with a corner of 0.1 to 3 rad/s, scaled to the bound."""
    from scipy.signal import lfilter

    count, pole = round(t_end / NOISE_STEP) + 1, np.exp(-NOISE_STEP * 10 ** rng.uniform(-1, 0.5))
    values = lfilter([1 - pole], [1, -pole], rng.standard_normal(count))
    return Recorded(NOISE_STEP * np.arange(count), LARGEST_COMMAND * values / np.abs(values).max())


def train_of_steps(rng: np.random.Generator, t_end: float) -> Signal:
    """Levels drawn evenly, held for 1 s to 15 s."""
    times = np.cumsum(rng.uniform(1, 15, round(t_end / 8) + 1))
    return Steps(tuple(times.tolist()), tuple(rng.uniform(-LARGEST_COMMAND, LARGEST_COMMAND, len(times)).tolist()))


def jumps_ever_rarer(rng: np.random.Generator, t_end: float) -> Signal:
    """Between the two bounds, each after 1.5 to 2 times as long as the one before: nothing in between for ever longer."""
    ratio, times = float(rng.uniform(1.5, 2.0)), [1.0]
    while times[-1] * ratio < t_end:
        times.append(times[-1] * ratio)
    return Steps(tuple(times), tuple(LARGEST_COMMAND * (-1.0) ** i for i in range(len(times))))


def held(rng: np.random.Generator, _: float) -> Signal:
    """A constant, of any size up to the bound."""
    return Constant(float(rng.uniform(-LARGEST_COMMAND, LARGEST_COMMAND)))


KINDS: dict[str, Callable[[np.random.Generator, float], Signal]] = {
    "sum of sines": sums_of_sines,
    "square wave": square_wave,
    "chirp": chirp,
    "filtered noise": filtered_noise,
    "train of steps": train_of_steps,
    "jumps ever rarer": jumps_ever_rarer,
    "constant": held,
}


def commands(draws: int, t_end: float) -> list[tuple[str, Signal]]:
    """So many of each kind."""
    rng = np.random.default_rng(SEED)
    return [(kind, make(rng, t_end)) for kind, make in KINDS.items() for _ in range(draws)]


def quarter_errors(command: Signal, t_end: float, controller: Controller, h: float) -> Array:
    """(4,) max |e| in the quarters of a run, over the largest |x_m|."""
    given, simulation = variant(reference=command), Simulation(t_end=t_end, dt=h)
    found = simulate_ensemble([(given, controller)], simulation, quarters=True).quarters
    assert found is not None  # asked for
    return np.asarray(found[0].max(axis=1) / Motion.of(given, simulation).largest)


def of_mrac() -> Reading:
    """Theorem 1 (i) for as many commands as the plain command tries, whatever is measured beside it."""
    tried = commands(DRAWS, T_END)
    found = np.array([quarter_errors(command, T_END, Mrac(gamma=MRAC_GAIN), MRAC_STEP) for _, command in tried])
    falls, last = found[:, 3] / found[:, 0], found[:, 3]
    return Reading(
        f"Theorem 1 (i): the standard MRAC's too, Gamma = {MRAC_GAIN:g}, in the last quarter below a tenth of the first's",
        verdict(holds=bool((falls < FALL_OF_MRAC).all())),
        f"of {len(tried)} commands at most {last.max():.2g} of the largest |x_m| in the last quarter of {T_END:g} s, {falls.max():.2g} of the first's "
        f"({tried[int(falls.argmax())][0]}); since the second it went to at most {(last / found[:, 1]).max():.2g} of what it was",
    )  # fmt: skip


def claim(*, full: bool = False) -> Claim:
    """The error at the end for every command, and that it is smaller than it was."""
    t_end = LONGER if full else T_END
    tried = commands(MORE_DRAWS if full else DRAWS, t_end)
    found = np.array([quarter_errors(command, t_end, section_v.robust_mrac("r"), H)[[1, 3]] for _, command in tried])
    early, late = found.T
    worst, slowest = int(late.argmax()), int((late / early).argmax())
    readings = (*_readings(early, late, tried[slowest][0]), of_mrac())
    return Claim(
        "any-command", "Theorem 1 (i); Theorem 2; Section III.B, last paragraph", "Without modelling error the error of the robust MRAC, and of the standard one, goes to zero for any bounded command",
        of_readings(readings),
        f"{len(tried)} commands of {len(KINDS)} kinds: max |e| in the last quarter of {t_end:g} s is at most {late[worst]:.2g} of the largest |x_m| ({tried[worst][0]}), "
        f"median {np.median(late):.1g}. Since the second quarter it fell to "
        f"{(late / early).min():.1g} to {(late / early).max():.2g} of what it was, slowest: {tried[slowest][0]}; 1/t makes {ONE_OVER_T:.2g}, the paper names no rate",
        f"Section V, tau = 0.5 s, sign of (14) corrected, RK4, h = {H:g} s, |r| <= {LARGEST_COMMAND:g}, seed {SEED}. 'Any' can't be run: tested were "
        f"{', '.join(KINDS)}, {len(tried) // len(KINDS)} each. MRAC: h = {MRAC_STEP:g} s. Not tested: commands without a bound",
        listings=(_listing(tried, found, t_end),),
        number=f"largest final |e| over the largest |x_m|, of {len(tried)} commands: {late[worst]:.2g}",
        readings=readings,
        would_change="one bounded command whose error stops falling; a proof covers all of them, a run never does",
        sharpened=f"{MORE_DRAWS} commands of each kind over {LONGER:g} s",
    )  # fmt: skip


def _readings(early: Array, late: Array, slowest: str) -> tuple[Reading, ...]:
    """Pure least squares gives 1/t where the command excites all along; rare jumps are met anew each time."""
    return (
        Reading(
            "the error of every command that was tried falls",
            verdict(holds=bool((late < early).all())),
            f"{int((late < early).sum())} of {len(late)} fell from the second to the last quarter, the slowest to {(late / early).max():.2g} ({slowest})",
        ),
        Reading(
            "it is small at the end",
            verdict(holds=bool((late < SMALL_ERROR_SHARE).all())),
            f"at most {late.max():.2g} of the largest |x_m|; small: below {SMALL_ERROR_SHARE:g}",
        ),
    )  # fmt: skip


def _listing(tried: list[tuple[str, Signal]], found: Array, t_end: float) -> Listing:
    names = np.array([kind for kind, _ in tried])
    return Listing(
        f"max |e| over the largest |x_m| in the second and in the last quarter of {t_end:g} s: the least and the largest of a "
        f"kind's {len(tried) // len(KINDS)} commands",
        ("command", "second quarter", "last quarter"),
        tuple((kind, *(span(column[names == kind]) for column in found.T)) for kind in KINDS),
    )
