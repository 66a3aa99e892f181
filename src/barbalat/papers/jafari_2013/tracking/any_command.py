"""Theorems 1 (i) and 2 without modelling error state that e -> 0 for any bounded command. Many random commands of seven kinds
test this."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from barbalat.controllers import Mrac
from barbalat.papers.claim import Claim, Listing, Measurement, span
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import variant
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.papers.jafari_2013.statements import MENDED
from barbalat.protocols import Controller, Signal
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.signals import Chirp, Constant, Recorded, Sines, Square, Steps
from barbalat.solvers.simulation import Simulation
from barbalat.study.reference_motion import ReferenceMotion
from barbalat.validate import Array

SEED = 20130820  # an arbitrary fixed number, so the draws are the same on every machine
DRAWS, MORE_DRAWS = 2, 12
"""Number of commands of each kind without and with ``--full``."""
LARGEST_COMMAND = 50.0
"""The largest |r| of Section V."""
T_END, LONGER_T_END = 400.0, 1600.0
"""Horizons [s] without and with ``--full``. Each quarter of the shorter run contains eight periods of Section V's
command."""
STEP = 2e-3
"""The step [s], a twentieth of the step at which RK4 shows its fourth order on the fastest dynamics, which depend on tau. Jumps
coincide with steps."""
MRAC_GAIN, MRAC_STEP = 0.01, 5e-3
"""Gain of the standard MRAC. It is small enough for a visible error in the first quarter, and h omega_a is 0.35 at |x| = 50."""
SMALL_ERROR_SHARE = 1e-3
"""Fraction of the largest |x_m| below which the error at the end counts as close to zero."""
ROUNDING_SHARE = 1e-12
"""Fraction of the largest |x_m| below which an error is only rounding in double precision and falls no further."""
ONE_OVER_T = 1 / 3
"""The ratio of the errors in the last and the second quarter if the error fell as 1/t: the start of the second quarter divided
by the start of the last."""
NOISE_STEP = 0.05
"""Time [s] between the samples of the noise, which is linear in between."""


def sums_of_sines(rng: np.random.Generator, _: float) -> Signal:
    """Draw two to six sines over two decades of frequency."""
    count = int(rng.integers(2, 7))
    shares = rng.dirichlet(np.ones(count))
    return Sines(tuple(LARGEST_COMMAND * shares), tuple(10 ** rng.uniform(-1, 1, count)), tuple(rng.uniform(0, 2 * np.pi, count)))


def square_wave(rng: np.random.Generator, _: float) -> Signal:
    """Draw a square wave with half periods of 1.5 s to 30 s."""
    return Square(LARGEST_COMMAND, float(10 ** rng.uniform(-1, 0.3)), phase=float(rng.uniform(0, 2 * np.pi)))


def chirp(rng: np.random.Generator, t_end: float) -> Signal:
    """Draw a chirp over the whole run that ends at 1 to 100 rad/s."""
    return Chirp(LARGEST_COMMAND, float(rng.uniform(0.02, 0.5)), float(10 ** rng.uniform(0, 2)), t_end)


def filtered_noise(rng: np.random.Generator, t_end: float) -> Signal:
    """Draw white noise behind a first-order lag with a corner of 0.1 to 3 rad/s, scaled to the bound."""
    from scipy.signal import lfilter

    count, pole = round(t_end / NOISE_STEP) + 1, np.exp(-NOISE_STEP * 10 ** rng.uniform(-1, 0.5))
    values = lfilter([1 - pole], [1, -pole], rng.standard_normal(count))
    return Recorded(NOISE_STEP * np.arange(count), LARGEST_COMMAND * values / np.abs(values).max())


def train_of_steps(rng: np.random.Generator, t_end: float) -> Signal:
    """Draw levels uniformly, each held for 1 s to 15 s."""
    times = np.cumsum(rng.uniform(1, 15, round(t_end / 8) + 1))
    return Steps(tuple(times.tolist()), tuple(rng.uniform(-LARGEST_COMMAND, LARGEST_COMMAND, len(times)).tolist()))


def jumps_ever_rarer(rng: np.random.Generator, t_end: float) -> Signal:
    """Draw jumps between the two bounds. Each interval is 1.5 to 2 times as long as the previous one."""
    ratio, times = float(rng.uniform(1.5, 2.0)), [1.0]
    while times[-1] * ratio < t_end:
        times.append(times[-1] * ratio)
    return Steps(tuple(times), tuple(LARGEST_COMMAND * (-1.0) ** i for i in range(len(times))))


def held(rng: np.random.Generator, _: float) -> Signal:
    """Draw a constant command of any size up to the bound."""
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
    """Draw this number of commands of each kind."""
    rng = np.random.default_rng(SEED)
    return [(kind, make(rng, t_end)) for kind, make in KINDS.items() for _ in range(draws)]


def quarter_errors(command: Signal, t_end: float, controller: Controller, h: float) -> tuple[Array, float]:
    """Return max |e| in the quarters of a run (4,), and the integral of |e|^2 over the whole run."""
    given, simulation = variant(reference=command), Simulation(t_end=t_end, dt=h)
    run = simulate_ensemble([(given, controller)], simulation, quarters=True)
    assert run.quarters is not None  # the run was asked to record them
    return np.asarray(run.quarters[0].max(axis=1)), float((run.metrics.rms_e[0] ** 2).sum() * t_end)


def _largest(command: Signal, t_end: float) -> float:
    return ReferenceMotion.of(variant(reference=command), Simulation(t_end=t_end, dt=STEP)).largest


@dataclass(frozen=True, eq=False)
class CommandErrors:
    """The results of one scheme for all commands.

    quarters  (commands, 4) max |e| in the quarters of a run, divided by the largest |x_m|
    squared   (commands,) the integral of |e|^2 over the run
    """

    scheme: str
    kinds: tuple[str, ...]
    quarters: Array
    squared: Array

    @property
    def late(self) -> Array:
        return np.asarray(self.quarters[:, 3])

    @property
    def ratios(self) -> Array:
        """The error of the last quarter divided by that of the second; zero if the last error is only rounding."""
        return np.where(self.late < ROUNDING_SHARE, 0.0, self.late / self.quarters[:, 1])

    @property
    def small(self) -> Reading:
        """The supplementary reading that the error is small at the end of the run. The sentence does not name a rate."""
        small, worst = self.late < SMALL_ERROR_SHARE, int(self.late.argmax())
        return Reading(
            f"{self.scheme}: at the end of the run the error is below {SMALL_ERROR_SHARE:g} of the largest |x_m| with every command",
            bool(small.all()),
            f"{int(small.sum())} of {len(small)} are. The largest error is {self.late[worst]:.2g} ({self.kinds[worst]}), and "
            f"each is at most {(self.late / self.quarters[:, 0]).max():.2g} of the first quarter's error",
            "beside",
        )

    @property
    def fell(self) -> str:
        """A sentence that states how many errors fell from the second quarter to the last, and how slowly the slowest fell."""
        slowest = int(self.ratios.argmax())
        return f"{int((self.ratios < 1).sum())} of {len(self.ratios)} errors fell, the slowest to {self.ratios[slowest]:.2g} of its value ({self.kinds[slowest]})"


def followed(tried: Sequence[tuple[str, Signal]], t_end: float) -> tuple[CommandErrors, CommandErrors]:
    """Run the robust MRAC of Figure 2, for Theorem 2, and the standard MRAC, for Theorem 1 (i)."""
    largest = np.array([[_largest(command, t_end)] for _, command in tried])
    kinds, found = tuple(kind for kind, _ in tried), []
    for scheme, controller, h in (
        ("the robust MRAC", section_v.robust_mrac("r"), STEP),
        (f"the standard MRAC, Gamma = {MRAC_GAIN:g}", Mrac(gamma=MRAC_GAIN), MRAC_STEP),
    ):
        runs = [quarter_errors(command, t_end, controller, h) for _, command in tried]
        found.append(
            CommandErrors(
                scheme, kinds, np.array([errors for errors, _ in runs]) / largest, np.array([squared for _, squared in runs])
            )
        )
    return found[0], found[1]


def claim(*, full: bool = False) -> Claim:
    """Measure the final error for every command, and whether it has decreased."""
    t_end = LONGER_T_END if full else T_END
    tried = commands(MORE_DRAWS if full else DRAWS, t_end)
    robust, standard = followed(tried, t_end)
    worst, slowest = int(robust.late.argmax()), int(robust.ratios.argmax())
    V_0 = float((section_v.problem().plant.theta ** 2).sum()) / MRAC_GAIN  # theta_hat(0) = 0, e(0) = 0
    spent, sentence = standard.squared / V_0, SENTENCES["any-command"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(bool((spent <= 1).all()), f"the integral is {span(spent)} of V(0) over {len(tried)} commands"),
            sentence.reads(bool((robust.ratios < 1).all()), robust.fell, 1),
            Reading("the standard MRAC's error falls from the second quarter to the last with every command", bool((standard.ratios < 1).all()), standard.fell, "beside"),
            robust.small,
            standard.small,
        ),
        shows=f"With {len(tried)} commands, MRAC's integral of |e|^2 is at most {spent.max():.2g} of V(0); the robust MRAC's "
        f"error in the last quarter is at most {robust.ratios.max():.2g} of that in the second.",
        measured=        f"with {len(tried)} commands of {len(KINDS)} kinds, max |e| of the robust MRAC in the last quarter of "
        f"{t_end:g} s is at most {robust.late[worst]:.2g} of the largest |x_m| ({tried[worst][0]}), median "
        f"{np.median(robust.late):.1g}. From the second quarter to the last it fell to between {robust.ratios.min():.1g} and "
        f"{robust.ratios.max():.2g} of its value, most slowly with {tried[slowest][0]}; 1/t would give {ONE_OVER_T:.2g}, and "
        f"the paper does not state a rate. The standard MRAC's error in the last quarter is at most {standard.late.max():.2g}, "
        f"and at most {standard.ratios.max():.2g} of its value in the second",
        how=f"Section V, tau = 0.5 s, {MENDED}, RK4, h = {STEP:g} s, |r| <= {LARGEST_COMMAND:g}, seed {SEED}. 'Any' cannot be "
        f"simulated; the kinds tested are {', '.join(KINDS)}, with {len(tried) // len(KINDS)} commands of each. MRAC: h = "
        f"{MRAC_STEP:g} s. An error below {ROUNDING_SHARE:g} of |x_m| counts as fallen. Unbounded commands were not tested",
        listings=tuple(_listing(each, t_end) for each in (robust, standard)),
        would_change="a command for which the integral exceeds V(0), or for which the robust MRAC's error rises from the second "
        "quarter to the last. The standard MRAC's error goes to zero without a guaranteed rate, and may rise in between. The "
        "proofs of both theorems cover all commands, which no run can do",
        sharpened=f"{MORE_DRAWS} commands of each kind over {LONGER_T_END:g} s, for both schemes",
    )  # fmt: skip


def _listing(of: CommandErrors, t_end: float) -> Listing:
    names = np.array(of.kinds)
    return Listing(
        f"largest |e| divided by the largest |x_m| in the first, second and last quarter of {t_end:g} s, {of.scheme}: the "
        f"smallest and largest of the {len(names) // len(KINDS)} commands of each kind",
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
