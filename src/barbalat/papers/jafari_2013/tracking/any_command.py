"""Theorems 1 (i) and 2 without modelling error: e -> 0 for any bounded command; here many, of seven kinds, drawn at random."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from barbalat.controllers import Mrac
from barbalat.papers.claim import Claim, Listing, Measurement, Reading, of_readings, span, verdict
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import variant
from barbalat.protocols import Controller, Signal
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.signals import Chirp, Constant, Recorded, Sines, Square, Steps
from barbalat.solvers.simulation import Simulation
from barbalat.study.reference_motion import ReferenceMotion
from barbalat.validate import Array

SEED = 20130820  # any fixed number: the draws are the same on every machine
DRAWS, MORE_DRAWS = 2, 12
"""Of each kind, by the plain command and by ``--full``."""
LARGEST_COMMAND = 50.0
"""|r| of Section V."""
T_END, LONGER_T_END = 400.0, 1600.0
"""[s], by the plain command and by ``--full``: the shorter run's quarters have eight periods of Section V's command each."""
STEP = 2e-3
"""20 times below what the fastest dynamics, those of tau, need for RK4's fourth order to show; jumps are met exactly."""
MRAC_GAIN, MRAC_STEP = 0.01, 5e-3
"""Of the standard MRAC: slow enough for a first quarter in which there is an error to fall from, and h omega_a = 0.35 at |x| = 50."""
SMALL_ERROR_SHARE = 1e-3
"""Of the largest |x_m|: what counts as close to zero at the end."""
ROUNDING_SHARE = 1e-12
"""Of the largest |x_m|: an error below it is zero as doubles have it, and falls no further."""
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
    """(4,) max |e| in the quarters of a run."""
    given, simulation = variant(reference=command), Simulation(t_end=t_end, dt=h)
    found = simulate_ensemble([(given, controller)], simulation, quarters=True).quarters
    assert found is not None  # asked for
    return np.asarray(found[0].max(axis=1))


def _largest(command: Signal, t_end: float) -> float:
    return ReferenceMotion.of(variant(reference=command), Simulation(t_end=t_end, dt=STEP)).largest


@dataclass(frozen=True, eq=False)
class CommandErrors:
    """What one scheme made of all commands: (commands, 4) max |e| in the quarters of a run, over the largest |x_m|."""

    scheme: str
    kinds: tuple[str, ...]
    quarters: Array

    @property
    def late(self) -> Array:
        return np.asarray(self.quarters[:, 3])

    @property
    def ratios(self) -> Array:
        """The last quarter's over the second's; zero where the last is nothing but rounding."""
        return np.where(self.late < ROUNDING_SHARE, 0.0, self.late / self.quarters[:, 1])

    @property
    def risen(self) -> tuple[str, ...]:
        """The kinds of the commands whose error did not fall from the second quarter to the last."""
        return tuple(dict.fromkeys(kind for kind, ratio in zip(self.kinds, self.ratios, strict=True) if ratio >= 1))

    @property
    def readings(self) -> tuple[Reading, Reading]:
        """Return two readings for each scheme: less than before, and little."""
        fell, small, slowest = self.ratios < 1, self.late < SMALL_ERROR_SHARE, int(self.ratios.argmax())
        worst = int(self.late.argmax())
        return (
            Reading(
                f"{self.scheme}: the error of every command that was tried falls from the second quarter to the last",
                verdict(holds=bool(fell.any()), conditional=not fell.all()),
                f"{int(fell.sum())} of {len(fell)} fell, the slowest went to {self.ratios[slowest]:.2g} of what it was ({self.kinds[slowest]})",
            ),
            Reading(
                f"{self.scheme}: it is small at the end",
                verdict(holds=bool(small.any()), conditional=not small.all()),
                f"{int(small.sum())} of {len(small)} are below {SMALL_ERROR_SHARE:g} of the largest |x_m|, the largest {self.late[worst]:.2g} ({self.kinds[worst]}), "
                f"{(self.late / self.quarters[:, 0]).max():.2g} of the first quarter's at most",
            ),
        )  # fmt: skip


def followed(tried: Sequence[tuple[str, Signal]], t_end: float) -> tuple[CommandErrors, CommandErrors]:
    """The robust MRAC of Figure 2, Theorem 2, and the standard MRAC, Theorem 1 (i)."""
    largest = np.array([[_largest(command, t_end)] for _, command in tried])
    kinds, found = tuple(kind for kind, _ in tried), []
    for scheme, controller, h in (
        ("the robust MRAC", section_v.robust_mrac("r"), STEP),
        (f"the standard MRAC, Gamma = {MRAC_GAIN:g}", Mrac(gamma=MRAC_GAIN), MRAC_STEP),
    ):
        errors = np.array([quarter_errors(command, t_end, controller, h) for _, command in tried])
        found.append(CommandErrors(scheme, kinds, errors / largest))
    return found[0], found[1]


def claim(*, full: bool = False) -> Claim:
    """The error at the end for every command, and that it is smaller than it was."""
    t_end = LONGER_T_END if full else T_END
    tried = commands(MORE_DRAWS if full else DRAWS, t_end)
    robust, standard = followed(tried, t_end)
    readings = (*robust.readings, *standard.readings)
    worst, slowest = int(robust.late.argmax()), int(robust.ratios.argmax())
    return Claim(
        "any-command", "Theorem 1 (i); Theorem 2; Section III.B, last paragraph", "Without modelling error the error of the robust MRAC, and of the standard one, goes to zero for any bounded command",
        of_readings(readings),
        f"{len(tried)} commands of {len(KINDS)} kinds: max |e| of the robust MRAC in the last quarter of {t_end:g} s is at most {robust.late[worst]:.2g} of the largest |x_m| ({tried[worst][0]}), "
        f"median {np.median(robust.late):.1g}. Since the second quarter it fell to "
        f"{robust.ratios.min():.1g} to {robust.ratios.max():.2g} of what it was, slowest: {tried[slowest][0]}; 1/t makes {ONE_OVER_T:.2g}, the paper names no rate. "
        f"The standard MRAC's: {standard.late.max():.2g} at most, since the second quarter {standard.ratios.max():.2g} of what it was",
        f"Section V, tau = 0.5 s, sign of (14) corrected, RK4, h = {STEP:g} s, |r| <= {LARGEST_COMMAND:g}, seed {SEED}. 'Any' can't be run: tested were "
        f"{', '.join(KINDS)}, {len(tried) // len(KINDS)} each. MRAC: h = {MRAC_STEP:g} s. An error below {ROUNDING_SHARE:g} of |x_m| counts as fallen. Not tested: commands without a bound",
        listings=tuple(_listing(each, t_end) for each in (robust, standard)),
        number=f"final |e|/|x_m|: MRAC {standard.late.max():.2g}, robust one {robust.late[worst]:.2g}",
        readings=readings,
        condition=_condition(robust, standard, t_end),
        would_change="confirmed: longer runs in which no command's error is larger in the last quarter than in the second; not confirmed: a command whose "
        "error does not go to zero. Both theorems have proofs, which cover all commands; a run never does",
        sharpened=f"{MORE_DRAWS} commands of each kind over {LONGER_T_END:g} s, for both schemes",
    )  # fmt: skip


def _condition(robust: CommandErrors, standard: CommandErrors, t_end: float) -> str:
    """Which commands the runs have not shown to be followed better and better, where there are some."""
    risen = [f"{each.scheme} with a command that is a {' or a '.join(each.risen)}" for each in (robust, standard) if each.risen]
    large = [each.scheme for each in (robust, standard) if not (each.late < SMALL_ERROR_SHARE).all()]
    said = []
    if risen:
        said.append(
            f"in these runs of {t_end:g} s the last quarter's error was larger than the second's for {'; for '.join(risen)}: longer ones are needed"
        )
    if large:
        said.append(f"{' and '.join(large)} not yet below {SMALL_ERROR_SHARE:g} of |x_m| at their end with every command")
    return "; ".join(said)


def _listing(of: CommandErrors, t_end: float) -> Listing:
    names = np.array(of.kinds)
    return Listing(
        f"max |e| over the largest |x_m| in the first, the second and the last quarter of {t_end:g} s, {of.scheme}: the least and the largest of a "
        f"kind's {len(names) // len(KINDS)} commands",
        ("command", "first quarter", "second quarter", "last quarter"),
        tuple((kind, *(span(column[names == kind]) for column in of.quarters[:, [0, 1, 3]].T)) for kind in KINDS),
    )


ROWS = (
    Measurement(
        claim,
        5.0,
        {"any-command": "the error goes to zero for any bounded command"},
        place=300,
        sharper=partial(claim, full=True),
        sharper_seconds=24.0,
    ),
)
