"""The limits of boundedness of the projected MRAC (3)-(4) and of L1-AC (5)-(8) with unmodelled dynamics.

Projection bounds the estimates but not the state. Some estimates of the known set do not stabilise the plant, and the law must
leave them in time. If a run grows without bound, no proof of boundedness can exist. For both schemes, (x, r, x(0)) multiplied by
c, with Gamma divided by c^2, gives exactly the same motion, scaled. Therefore no gain, however small, is reasonable for all
commands.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from barbalat.certificates.bounds import theorem_1
from barbalat.certificates.linear_loops.ideal import fast_adaptation, known_parameters
from barbalat.controllers import L1Adaptive, Mrac
from barbalat.linear.enclosure import OUTWARD_FACTOR
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.largest import largest
from barbalat.linear.margins import margins
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.papers.claim import Claim, Listing, Measurement, numbers, span, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import figures, variant
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.plant import Plant, ReferenceModel
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller, Signal
from barbalat.signals import Constant, Sines
from barbalat.solvers.simulation import Simulation
from barbalat.study.reference_motion import ReferenceMotion
from barbalat.validate import Array

# With Rohrs' model -3 x_m + 3 r the plant is x' = -3 x + 2 (theta x + v) with theta = 1 and k_0 = 1.5. For a fixed theta_hat the
# characteristic polynomial is (s + 1)(s^2 + 30 s + 229) + 458 C theta_hat. Without a filter it is stable between -0.5 and 17.03.

UNMODELLED = TransferFunction([229.0], [1.0, 30.0, 229.0])
COMMANDS: dict[str, Signal] = {"r = 0.3 + 1.85 sin 16.1t": Sines((1.85,), (16.1,), constant=0.3), "r = 2": Constant(2.0)}
ROHRS_GAINS = (1.0, 10.0, 100.0, 1000.0)
WIDE_BOUND, NARROW_BOUND = 20.0, 5.0
"""Bounds of two known sets: |theta| <= 20, which contains gains that make the loop unstable, and |theta| <= 5."""
KAPPAS = (0.02, 0.1)
"""Time constants [s] of Section V's filter and of a filter with about a third of the plant's bandwidth."""
ROHRS_T_END, ROHRS_STEP = 200.0, 1e-3
"""Horizon [s], two hundred time constants of the plant. The step times the unmodelled modes' 15 rad/s is 0.015."""


def problem(width: float, command: Signal) -> Problem:
    """Return the problem with the known set |theta| <= width."""
    return Problem(
        plant=Plant(A_m=[[-3.0]], b=[2.0], theta=[1.0], input=PlantInput(actuator=UNMODELLED)),
        reference_model=ReferenceModel(k_0=1.5),
        reference=command,
        uncertainty=ParameterBox(lower=[-width], upper=[width]),
    )


def scheme(kappa: float | None, gamma: float) -> Controller:
    """Return MRAC, or L1-AC with the first-order filter."""
    return Mrac(gamma=gamma) if kappa is None else L1Adaptive(gamma=gamma, filter=input_filter(kappa))


def diverged_at(kappa: float | None, command: Signal) -> Array:
    """Return the time [s] at which each run diverged (2, gains), with the wide and with the narrow known set; NaN if it did
    not."""
    pairs = [(problem(width, command), scheme(kappa, gamma)) for width in (WIDE_BOUND, NARROW_BOUND) for gamma in ROHRS_GAINS]
    return np.asarray(figures(pairs, ROHRS_T_END, ROHRS_STEP).diverged_at.reshape(2, -1))


def largest_gain(kappa: float | None) -> float:
    """Return the largest theta_hat with a stable frozen loop, found from its characteristic roots."""
    nominal = (
        np.polymul([1.0, 1.0], UNMODELLED.den)
        if kappa is None
        else np.polymul(np.polymul([1.0, 1.0], UNMODELLED.den), [kappa, 1.0])
    )

    def is_stable(gain: float) -> bool:
        return bool(np.roots(np.polyadd(nominal, [2.0 * 229.0 * gain])).real.max() < 0)

    return largest(is_stable, 1e-3, 1e3, within=1e-10)


def compared_with_rohrs() -> tuple[tuple[Reading, ...], Listing]:
    """Compare the times of divergence for a known set that contains destabilising gains and for one that does not."""
    at = {kappa: {name: diverged_at(kappa, command) for name, command in COMMANDS.items()} for kappa in (None, *KAPPAS)}
    wide = {kappa: np.array([each[0] for each in found.values()]) for kappa, found in at.items()}
    narrow = {kappa: np.array([each[1] for each in found.values()]) for kappa, found in at.items()}
    lost, kept = partial(_text, wide), KAPPAS[1]
    readings = (
        Reading(
            "they can also diverge on Rohrs' plant, which the paper does not name, with |theta| <= 20",
            bool(np.isfinite(wide[None]).any() and np.isfinite(wide[KAPPAS[0]]).any()),
            f"{lost(None)}; {lost(KAPPAS[0])}. The frozen loops are stable with theta_hat up to {largest_gain(None):.3g} and "
            f"{largest_gain(KAPPAS[0]):.3g}. With |theta| <= {NARROW_BOUND:g}, "
            f"{sum(int(np.isfinite(each).sum()) for each in narrow.values())} of {sum(each.size for each in narrow.values())} runs diverge",
            "beside",
        ),
        Reading(
            "on the same plant, L1-AC can also diverge with the slower filter",
            bool(np.isfinite(wide[kept]).any()),
            f"{lost(kept)}: in these runs L1-AC with the slower filter stays bounded although MRAC diverges",
            "beside",
        ),
    )  # fmt: skip
    return readings, _listing(at)


def _listing(at: dict[float | None, dict[str, Array]]) -> Listing:
    """Return a table with a row for each scheme and known set."""
    earliest = {kappa: np.fmin(*found.values()) for kappa, found in at.items()}  # NaN if no command's run is lost
    schemes: dict[str, Sequence[str] | Array] = {
        "scheme": [_name(kappa) for kappa in at for _ in (WIDE_BOUND, NARROW_BOUND)],
        "known set": [f"|theta| <= {width:g}" for width in (WIDE_BOUND, NARROW_BOUND)] * len(at),
    }
    by_gain = {
        f"Gamma = {gain:g}": np.concatenate([found[:, i] for found in earliest.values()]) for i, gain in enumerate(ROHRS_GAINS)
    }
    return table(
        f"Rohrs' plant: the time [s] at which the first of the runs with {len(COMMANDS)} commands diverges within "
        f"{ROHRS_T_END:g} s, or - if none diverges",
        schemes | by_gain,
    )


def _name(kappa: float | None) -> str:
    return "MRAC" if kappa is None else f"L1-AC, kappa = {kappa:g} s"


def _text(wide: dict[float | None, Array], kappa: float | None) -> str:
    """Return a sentence on the gains at which the runs are lost with either command."""
    gone = np.isfinite(wide[kappa]).any(axis=0)
    tried = f"of the {len(ROHRS_GAINS)} gains from {ROHRS_GAINS[0]:g} to {ROHRS_GAINS[-1]:g}"
    if not gone.any():
        return f"{_name(kappa)} diverges at none {tried}"
    return f"{_name(kappa)} diverges at {gone.sum()} {tried}, first at {np.nanmin(wide[kappa]):.3g} s"


THETAS = ((4.0, -3.0), (0.0, 0.0), (5.0, 5.0), (-5.0, 5.0), (5.0, -5.0), (-5.0, -5.0))
"""Section V's theta, the centre of its known set, and the four corners."""
GAINS, MORE_GAINS = (1.0, 100.0), (1e-2, 1.0, 100.0, 1e4)
DELAYS = np.round(np.geomspace(0.02, 1.0, 14), 3)
"""Delays d [s]. They are Delta_m = e^(-s d) - 1, whose first term is the paper's -mu s."""
T_END, STEP = 120.0, 1e-3
"""Horizon [s], ten periods of the command. Growth of 15 % per second exceeds the bound below in that time."""
UNBOUNDED_RATIO = 100.0
"""A run counts as unbounded if |e| in the last quarter exceeds this multiple of the largest |x_m|. Bounded runs stay below 20, as
the listing shows."""
PROVEN_DELAY = 0.1
"""Largest delay [s] to which the small-gain theorem is applied."""
SCHEMES: dict[str, Callable[[float], Controller]] = {
    "MRAC (3)-(4)": lambda gamma: Mrac(gamma=gamma),
    "L1-AC (5)-(8)": lambda gamma: section_v.l1("L1", gamma),
}


@dataclass(frozen=True, eq=False)
class Loss:
    """The results (6, gains) for each theta and gain: the largest delay below the first delay with a lost run, this first delay,
    and the largest tail error."""

    tolerates: Array
    loses: Array
    tail: Array

    def before(self, theta: int, delay: float) -> bool:
        """True if at every gain the run with some delay below the given one is lost."""
        return bool((self.loses[theta] < delay).all())


def lost(members: Sequence[tuple[tuple[float, ...], float, float]], scheme: str, h: float = STEP) -> tuple[Array, Array]:
    """Return which combinations (theta, gain, delay) are unbounded, and max |e| in their last quarter divided by the largest
    |x_m|."""
    pairs = [(variant(theta=theta, input=PlantInput(delay=delay)), SCHEMES[scheme](gain)) for theta, gain, delay in members]
    largest = ReferenceMotion.of(section_v.problem(), Simulation(t_end=T_END, dt=STEP)).largest
    tail = figures(pairs, T_END, h).tail_max_abs_e.max(axis=1) / largest
    return np.isnan(tail) | (tail > UNBOUNDED_RATIO), tail


def search(scheme: str, gains: tuple[float, ...], h: float = STEP) -> Loss:
    """Scan DELAYS for every theta and gain."""
    members = [(theta, gain, float(delay)) for theta in THETAS for gain in gains for delay in DELAYS]
    gone, tail = (part.reshape(len(THETAS), len(gains), len(DELAYS)) for part in lost(members, scheme, h))
    first = np.where(gone.any(axis=2), gone.argmax(axis=2), len(DELAYS))
    kept = np.where(np.arange(len(DELAYS)) < first[..., None], tail, 0.0).max(axis=2)
    return Loss(np.append(0.0, DELAYS)[first], np.append(DELAYS, np.inf)[first], kept)


def ideal_margins(kappa: float | None) -> Array:
    """Return the exact delay margins [s] (6,) of the loop with theta known, u = -C theta'x."""
    C = None if kappa is None else input_filter(kappa).realise()
    plants = [variant(theta=theta).plant for theta in THETAS]
    return np.array([margins(known_parameters(plant, plant.theta, C)).delay for plant in plants])


def certain_size(kappa: float | None) -> float:
    """Return the largest s such that, by the small-gain theorem, x stays bounded for any motion of theta_hat if all |theta_i| and
    |theta_hat_i| are at most s.

    x = W_b[(theta - theta_hat)'x] + W_b (1 - C e^(-s d))[theta_hat'x] + bounded terms. ||W_b (1 - C e^(-s d))||_1 is at most
    ||W_b (1 - C)||_1 + d ||s W_b||_1 ||C||_1, with ||C||_1 = 1, |theta - theta_hat|_1 <= 4 s and |theta_hat|_1 <= 2 s.
    """
    known = section_v.problem().known
    plain = l1_norm(known.A_m, known.b[:, None], np.eye(2), np.zeros((2, 1))).upper
    behind = PROVEN_DELAY * theorem_1.derivative_norm(known).upper
    if kappa is not None:
        behind += theorem_1.filter_condition(known, input_filter(kappa).realise(), 1.0).norm.upper
    return 1 / ((4 * plain + 2 * behind) * OUTWARD_FACTOR**3)


def claim(*, full: bool = False) -> Claim:
    """Search for unbounded runs with delays and with Rohrs' actuator."""
    gains = MORE_GAINS if full else GAINS
    found = {name: search(name, gains, STEP / 4 if full else STEP) for name in SCHEMES}
    ideal = dict(zip(SCHEMES, (ideal_margins(None), ideal_margins(section_v.KAPPA)), strict=True))
    below = {name: [i for i in range(len(THETAS)) if each.before(i, ideal[name][i])] for name, each in found.items()}
    on_rohrs_plant, at_rohrs_plant = compared_with_rohrs()
    readings = (*_readings(found, ideal, below), *on_rohrs_plant)
    firsts = np.array([each.loses[i].max() for name, each in found.items() for i in below[name]] or [np.nan])
    return Claim(
        sentence=SENTENCES["unmodelled-unbounded"],
        readings=readings,
        shows=f"With a delay of {firsts.min():g} s, which the loop tolerates if theta is known, runs grow without bound at every gain tried.",
        measured=        f"the shortest delay with unbounded growth, at any gain tried: {_of_section_v(found, ideal)}. At every "
            f"gain, for {len(below['MRAC (3)-(4)'])} (MRAC) and {len(below['L1-AC (5)-(8)'])} (L1-AC) of {len(THETAS)} values "
            f"of theta in the known set, the same loop tolerates this delay, {firsts.min():g} s to {firsts.max():g} s, if theta "
            f"is known. For theta = 0: {_of_the_centre(found, ideal)}",
        how=f"Section V, theta over its known set, Gamma = {numbers(gains)}, {len(DELAYS)} exact delays from {DELAYS[0]:g} to "
        f"{DELAYS[-1]:g} s; RK4, h = {STEP / 4 if full else STEP:g} s, {T_END:g} s. A run counts as unbounded if it diverges or "
        f"if |e| in the last quarter exceeds {UNBOUNDED_RATIO:g} times the largest |x_m|; in all other runs |e| stays below "
        f"{max(float(each.tail.max()) for each in found.values()):.2g} times",
        listings=(*_listings(found, ideal, gains), at_rohrs_plant),
        would_change="a bound on x with Delta_m for Section V's known set and the unchanged laws (4) and (7), or a gain at "
        "which no run grows without bound",
        sharpened=f"{len(MORE_GAINS)} gains, Gamma = {span(MORE_GAINS)}, all at a quarter of the step",
    )  # fmt: skip


def _of_section_v(found: dict[str, Loss], ideal: dict[str, Array]) -> str:
    parts = [f"{name} {each.loses[0].min():g} s" for name, each in found.items()]
    known = ", ".join(_tolerated(values[0]) for values in ideal.values())
    return f"for Section V's theta {', '.join(parts)} (with theta known the loops tolerate {known})"


def _lost_at(delay: float) -> str:
    if np.isfinite(delay):
        return f"grows without bound at a delay of {delay:g} s"
    return f"stays bounded up to a delay of {DELAYS[-1]:g} s"


def _tolerated(delay: float) -> str:
    return f"{delay:.3g} s" if np.isfinite(delay) else "any delay"


def _of_the_centre(found: dict[str, Loss], ideal: dict[str, Array]) -> str:
    delays = " and ".join(f"{each.loses[1].max():g} s" for each in found.values())
    known = "any delay" if all(np.isinf(values[1]) for values in ideal.values()) else "less"
    return f"{delays}, and u = k_0 r without feedback tolerates {known}. For L1-AC: {_below_the_limit(found['L1-AC (5)-(8)'])}"


def _readings(found: dict[str, Loss], ideal: dict[str, Array], below: dict[str, list[int]]) -> tuple[Reading, ...]:
    def shown(i: int) -> str:
        return "; ".join(
            f"{name} {_lost_at(each.loses[i].max())} and tolerates {_tolerated(ideal[name][i])} if theta is known"
            for name, each in found.items()
        )

    same = all(bool((each.loses == each.loses[:, :1]).all()) for each in found.values())
    at_every = all(np.isfinite(each.loses[i]).all() for name, each in found.items() for i in below[name])
    sizes = {name: certain_size(kappa) for name, kappa in zip(found, (None, section_v.KAPPA), strict=True)}
    sentence = SENTENCES["unmodelled-unbounded"]
    return (
        sentence.reads(all(below.values()), f"theta = [5, 5]: {shown(2)}; theta = [4, -3]: {shown(0)}; theta = 0: {shown(1)}"),
        sentence.reads(
            all(below.values()) and at_every,
            f"the delay at which they grow without bound is {'the same' if same else 'not the same'} for every Gamma tried; this "
            "is exact, since Gamma/c^2 with c times the command gives the same motion",
            1,
        ),
        Reading(
            "no proof exists, however small the known set",
            not all(size > 0 for size in sizes.values()),
            f"with |theta_i| <= {_down(min(sizes.values()))} the small-gain theorem bounds x for every Gamma and delays up to {PROVEN_DELAY:g} s; Section V's set is {5 / min(sizes.values()):.0f} times as large",
            "beside",
        ),
    )  # fmt: skip


def _below_the_limit(found: Loss) -> str:
    """Return a sentence on the robustness measure of L1-AC's authors, which is the delay margin of the limit of fast
    adaptation."""
    C = input_filter(section_v.KAPPA).realise()
    limits = np.array([margins(fast_adaptation(variant(theta=theta).plant, C)).delay for theta in THETAS])
    tried = sum(int((limit > DELAYS).sum()) for limit in limits) * found.loses.shape[1]
    lost = sum(int((row < limit).sum()) for row, limit in zip(found.loses, limits, strict=True))
    return (
        f"its authors' measure, the delay margin as Gamma tends to infinity, is {limits.min():.3g} to {limits.max():.3g} s; "
        f"{lost} of {tried} runs with a shorter delay are unbounded"
    )


def _down(value: float) -> str:
    return f"{np.floor(1e4 * value) / 1e4:.4f}"


def _listings(found: dict[str, Loss], ideal: dict[str, Array], gains: tuple[float, ...]) -> tuple[Listing, ...]:
    return tuple(
        table(
            f"{name}: the largest delay [s] with a bounded run and the next one tried, which is unbounded (inf: none up to "
            f"{DELAYS[-1]:g} s); the delay tolerated with theta known; the largest |e| in the bounded runs' last quarter "
            f"divided by the largest |x_m|",
            {
                "theta": [f"[{theta[0]:g}, {theta[1]:g}]" for theta in THETAS for _ in gains],
                "Gamma": gains * len(THETAS),
                "bounded": each.tolerates.ravel(),
                "unbounded": each.loses.ravel(),
                "theta known": [_tolerated(delay) for delay in ideal[name] for _ in gains],
                "|e|/|x_m|": each.tail.ravel(),
            },
        )
        for name, each in found.items()
    )  # fmt: skip


ROWS = (
    Measurement(
        claim,
        2.0,
        {"unmodelled-unbounded": "projected MRAC and L1-AC with unmodelled dynamics"},
        place=310,
        sharper=partial(claim, full=True),
        sharper_seconds=4.0,
    ),
)
