"""A comparison that the paper omits, of adaptive schemes with linear robust designs on the same family of plants."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from barbalat.certificates.bounds import theorem_1
from barbalat.certificates.certify import certify
from barbalat.controllers import L1Adaptive, LinearFeedback, Mrac
from barbalat.design import hinf_feedback, pi_feedback
from barbalat.linear.systems import input_filter, two_slopes
from barbalat.papers.claim import Chart, ChartAxis, Claim, Curve, Listing, Measurement, short, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import figures, variant
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.papers.jafari_2013.statements import MENDED
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

DELAY = 0.01
"""Delay at the plant's input [s], a third of L1-AC's delay margin."""
DELAYS = np.geomspace(2e-3, 0.1, 24)
PI_DELAY, HINF_DELAY = 0.0118, 0.025
"""Unmodelled delays that give the two designs at least L1-AC's delay margin of 33 ms at Section V's theta."""
HINF_FAST_DELAY = 0.01
UNFOLLOWED_SHARE = 0.2
"""A controller is said not to follow the model if its error exceeds this fraction of the model's amplitude."""


UNSTABLE_ERROR_FACTOR = 10.0
"""A loop is taken to be unstable if its error exceeds this multiple of the model's amplitude."""


@dataclass(frozen=True, eq=False)
class TailErrors:
    """Tail errors max |e| over SIZES at the corner, without and with DELAY, and at the theta of Section V; NaN if the run
    diverged."""

    plain: Array
    delayed: Array
    at_paper: float
    largest_delay: float


L1_NAME, PI_NAME = "L1-AC, Γ = 100, κ = 0.02 s", "PI"


def claims() -> list[Claim]:
    """Measure both rows. Without ``barbalat[robust]`` their only linear design is the PI controller, and they say so."""
    contestants, missing = _contestants()
    measured = {c.name: _measure(c) for c in contestants}
    against_pi = claim(measured[L1_NAME].plain, measured[PI_NAME].plain)
    return [_adaptive_against_linear(contestants, measured, missing), against_pi, _non_adaptive(contestants, missing)]


THETAS = ((0.0, 0.0), (4.0, -3.0), (5.0, 5.0), (5.0, -5.0), (-5.0, 5.0), (-5.0, -5.0))
"""The centre of Section V's known set, the theta of Section V, and the corners of the set."""


def _non_adaptive(contestants: list[Controller], missing: str) -> Claim:
    """Decide whether a fixed linear design follows at the centre and at the corners of the known set."""
    sentence, problems = SENTENCES["non-adaptive-cannot"], [variant(theta=theta) for theta in THETAS]
    shares = {c.name: tail([(problem, c) for problem in problems]) / amplitude() for c in contestants}
    worst = {name: float(np.where(np.isnan(found), np.inf, found).max()) for name, found in shares.items()}
    linear = {c.name: worst[c.name] for c in contestants if _is_linear(c)}
    best = min(linear, key=lambda name: linear[name])
    following = [f"{name} {100 * share:.2g} %" for name, share in linear.items() if share < UNFOLLOWED_SHARE]
    return Claim(
        sentence=sentence,
        readings=(sentence.reads(not following, f"the largest tail error over the set, as a fraction of the model's amplitude: "
        f"{', '.join(following) or 'none below a fifth'}"),),
        shows=f"Over the set the tail error is at most {100 * linear[best]:.2g} % of the model's amplitude with {best}; with "
        f"L1-AC at Section V's kappa it is {100 * worst[L1_NAME]:.2g} %.",
        measured=f"the largest tail error over {len(THETAS)} values of theta in the known set, relative to the model's amplitude "
        f"of {amplitude():.0f}: "
        + "; ".join(f"{name} {100 * share:.2g} %" for name, share in worst.items()) + missing,
        how=f"Section V's command and set, RK4, h = {STEP:g} s, {T_END:g} s, no modelling error. The robust MRAC has {MENDED}; "
            f"the designs are those of adaptive-against-linear, fixed over the set",
        listings=(
            table(
                "The largest error in the tail, in per cent of the model's amplitude",
                {"theta": [f"[{a:g}, {b:g}]" for a, b in THETAS]} | {name: 100 * found for name, found in shares.items()},
            ),
        ),
        would_change="an uncertainty for which no fixed design tracks the model; adaptive-against-linear states the size of "
        "uncertainty that each design tolerates",
    )  # fmt: skip


def _contestants() -> tuple[list[Controller], str]:
    known = section_v.problem().known
    controllers: list[Controller] = [
        Mrac(gamma=section_v.MODERATE_GAIN, name="MRAC, Γ = 10"),
        section_v.l1(L1_NAME, 100.0),
        section_v.robust_mrac("Robust MRAC, τ = 0.5 s"),
        section_v.robust_mrac("Robust MRAC, τ = 0.02 s", 0.02),
        pi_feedback(known, unmodelled_delay=PI_DELAY, name=PI_NAME),
    ]
    missing = ""
    try:
        controllers += [
            hinf_feedback(known, unmodelled_delay=HINF_DELAY, name="H∞"),
            hinf_feedback(known, unmodelled_delay=HINF_FAST_DELAY, name="H∞, for 10 ms"),
        ]
    except InputError as error:
        missing = f". The H∞ designs are omitted: {error}"
    return controllers, missing


def _is_linear(controller: Controller) -> bool:
    return isinstance(controller, LinearFeedback)


def _measure(controller: Controller) -> TailErrors:
    plain = over_sizes(controller)
    with_delays = [given(size, DELAY) for size in SIZES] + [variant(input=PlantInput(delay=float(d))) for d in DELAYS]
    delayed, tolerated = np.split(tail([(problem, controller) for problem in with_delays]), [len(SIZES)])
    lost = np.flatnonzero(~(tolerated < UNFOLLOWED_SHARE * amplitude()))
    last = int(lost[0]) if len(lost) else len(DELAYS)
    return TailErrors(plain[:-1], delayed, float(plain[-1]), float(DELAYS[last - 1]) if last else 0.0)


def amplitude() -> float:
    """Return the amplitude of x_m,1 in the steady state, 50 |k_0/(s^2 + s + 0.3)| at 0.5 rad/s."""
    return float(50 * 4 / abs((0.5j) ** 2 + 0.5j + 0.3))


def _adaptive_against_linear(contestants: list[Controller], measured: dict[str, TailErrors], missing: str) -> Claim:
    sides = {"plain": "without a delay", "delayed": f"with an input delay of {1e3 * DELAY:g} ms"}
    beside = {
        part: [_against_the_best(c.name, words, getattr(measured[c.name], part), _best_linear(contestants, measured, part)) for c in contestants if not _is_linear(c)]
        for part, words in sides.items()
    }  # fmt: skip
    sentence = SENTENCES["adaptive-against-linear"]
    literal = tuple(
        sentence.reads(any(one.holds for one in found), _ahead(found), part) for part, found in enumerate(beside.values())
    )
    sentences = [
        f"{c.name} {measured[c.name].at_paper:.2g}, {at_one(measured[c.name].plain):.2g} and "
        f"{at_one(measured[c.name].delayed):.2g}"
        for c in contestants
    ]
    least, best = {}, {}
    for part in sides:
        errors = {c.name: at_one(getattr(measured[c.name], part)) for c in contestants if not _is_linear(c)}
        least[part] = float(np.nanmin(list(errors.values())))
        best[part] = at_one(_best_linear(contestants, measured, part))
    return Claim(
        sentence=sentence,
        readings=(*literal, *beside["plain"], *beside["delayed"]),
        shows=f"The settings were chosen, not tuned. At size 1 the smallest tail error is {least['plain']:.2g} (adaptive) and "
        f"{best['plain']:.2g} (linear); with a delay of {1e3 * DELAY:g} ms it is {least['delayed']:.2g} and "
        f"{best['delayed']:.2g}.",
        measured=        f"Tail error at the paper's theta, at the set's corner (5, 5), and there with an input delay of "
        f"{1e3 * DELAY:g} ms: {'; '.join(sentences)}. The model's amplitude is {amplitude():.0f}{missing}",
        how=f"Section V's command, RK4, h = {STEP:g} s, {T_END:g} s, set and theta scaled together by {len(SIZES)} sizes. "
            f"Halving the step changes the errors by a fraction of at most {_step_effect(contestants, measured):.1g} (size 1, "
            f"with the delay). PI and H∞ are designed for the delay margin of L1-AC; 'H∞, for 10 ms' is designed for a delay of "
            f"10 ms. The adaptive schemes' settings are chosen, not tuned by a rule, and the robust MRAC has {MENDED}. The "
            f"values kappa and tau = 0.5 s are the paper's, tau = 0.02 s equals kappa, and the step resolves the gains",
        maps=(_chart("linear-design", contestants, measured, "plain"), _chart("linear-design-delay", contestants, measured, "delayed")),
        listings=(_table(contestants, measured),),
        would_change="a linear design that uses more knowledge of the family, settings that are tuned to each size, or a "
        "different command or delay; here all settings are fixed",
    )  # fmt: skip


def _ahead(readings: list[Reading]) -> str:
    """Return a phrase that names the adaptive schemes that are better at every size."""
    always = [reading.says for reading in readings if reading.holds]
    return f"better at every size: {'; '.join(always) or 'none'}"


def _best_linear(contestants: list[Controller], measured: dict[str, TailErrors], part: str) -> Array:
    """Return the smallest error of a linear design at each size, infinite if all are lost."""
    errors = [getattr(measured[c.name], part) for c in contestants if _is_linear(c)]
    return np.min([np.where(np.isnan(e), np.inf, e) for e in errors], axis=0)


def _against_the_best(name: str, words: str, errors: Array, linear: Array) -> Reading:
    """Return the comparison at the sizes that some linear design tolerates."""
    alive = np.isfinite(linear)
    better = np.where(np.isnan(errors), np.inf, errors)[alive] < linear[alive]
    return Reading(
        f"{name}, {words}",
        bool(better.all()),
        f"better at {better.sum()} of {alive.sum()} sizes; at size 1 {at_one(errors):.2g} compared with {at_one(linear):.2g}",
        "beside",
    )


def _step_effect(contestants: list[Controller], measured: dict[str, TailErrors]) -> float:
    """Return the largest relative change of the errors, at size 1 and with the delay, when the step is halved."""
    problem = given(1.0, DELAY)
    fine = {c.name: float(tail([(problem, c)], STEP / 2)[0]) for c in contestants}
    return max(abs(at_one(measured[c.name].delayed) / fine[c.name] - 1) for c in contestants)


def _chart(key: str, contestants: list[Controller], measured: dict[str, TailErrors], part: str) -> Chart:
    delayed = part == "delayed"
    level = Curve("a fifth of the model's amplitude", [SIZES[0], SIZES[-1]], [UNFOLLOWED_SHARE * amplitude()] * 2)
    return Chart(
        key=key,
        title="Section V's family as its parameters grow" + (f", with an input delay of {1e3 * DELAY:g} ms" if delayed else ""),
        caption="The set and the true parameters are scaled together. The parameters are in the set's corner (5, 5), the "
        "direction in which the linear loops are weakest by mu; all controllers have fixed settings. " + ("The input has an "
            "exact delay, which no controller knows" if delayed else "Without modelling errors"),
        x=ChartAxis("size of the parameters (1: Section V)", SIZES, logarithmic=True),
        quantity="max |e| in the tail",
        lost=f"last size with |e| below {UNSTABLE_ERROR_FACTOR:g} amplitudes",
        curves=tuple(_until_lost(c.name, getattr(measured[c.name], part)) for c in contestants),
        levels=(level,),
    )  # fmt: skip


def _until_lost(label: str, errors: Array) -> Curve:
    lost = np.flatnonzero(~(errors < UNSTABLE_ERROR_FACTOR * amplitude()))
    end = int(lost[0]) if len(lost) else len(errors)
    return Curve(label, SIZES[:end], errors[:end])


def _table(contestants: list[Controller], measured: dict[str, TailErrors]) -> Listing:
    found = certify(section_v.problem(), contestants, Simulation(t_end=T_END, dt=STEP))
    rows = []
    for c in contestants:
        v, m = found[c.name].values, measured[c.name]
        rows.append((
            c.name,
            *(_shown(v.get(key), factor) for key, factor in (("delay_margin", 1e3), ("sensitivity_peak", 1), ("complementary_sensitivity_peak", 1))),
            _shown(v.get("parameter_scale"), round_off=math.floor), _shown(v.get("error_bound"), round_off=math.ceil),
            short(1e3 * m.largest_delay), f"{m.at_paper:.2g}", _lost_from(m.plain), _lost_from(m.delayed),
        ))  # fmt: skip
    return Listing(
        f"Margins and peaks are exact for the linear loop that the scheme is or tends to (MRAC and robust MRAC: estimates "
        f"fixed at theta; L1-AC: limit of fast adaptation). mu is exact at the frequencies tried. The bound is guaranteed over "
        f"the set. The last four columns are simulated; a controller counts as tracking while its tail error stays below "
        f"{UNFOLLOWED_SHARE:g} of the "
        f"model's amplitude",
        (
            "controller", "delay margin [ms]", "Ms", "Mt", "set may grow by 1/mu", "bound of |e|", "delay tolerated [ms]",
            "tail error", "follows below size", f"with {1e3 * DELAY:g} ms",
        ),
        tuple(rows),
    )  # fmt: skip


def _shown(value: Any, factor: float = 1.0, round_off: Callable[[float], float] = round) -> str:
    """Format a value with three digits. Bounds are rounded to their safe side, up or down."""
    if value is None:
        return "-"
    unit = 10.0 ** (math.floor(math.log10(factor * value)) - 2)
    return f"{round_off(factor * value / unit) * unit:.3g}"


def _lost_from(errors: Array) -> str:
    lost = np.flatnonzero(~(errors < UNFOLLOWED_SHARE * amplitude()))
    return f"{SIZES[lost[0]]:.2g}" if len(lost) else f"more than {SIZES[-1]:.2g}"


ROWS = (
    Measurement(
        claims,
        7.0,
        {
            "adaptive-against-linear": "adaptive schemes against linear robust designs",
            "l1-against-pi": "L1-AC against a PI controller",
            "non-adaptive-cannot": "fixed linear designs over the known set",
        },
        place=260,
    ),
)


GAMMA = 100.0
"""The gain of L1-AC in the comparison with linear designs. The loop is close to its limit of fast adaptation, and h = 1e-4 s
resolves it."""
THETA_MAX = 10.0
"""The largest |theta|_1 over Section V's known set."""


def claim(l1: Array, pi: Array) -> Claim:
    """Return the row from the tail errors of L1-AC with the first-order filter and of the PI over the sizes, (sizes,) each."""
    margin, kappa = section_v.limit_delay_margin(input_filter(section_v.KAPPA)), section_v.two_slopes_kappa()
    C = two_slopes(kappa)
    second = over_sizes(L1Adaptive(gamma=GAMMA, filter=C, name="two slopes"))[:-1]
    condition = theorem_1.filter_condition(section_v.problem().known, C.realise(), THETA_MAX).value_upper
    sentence, (first_holds, first), (second_holds, second_said) = (
        SENTENCES["l1-against-pi"],
        _compared(l1, pi),
        _compared(second, pi),
    )
    readings = (
        sentence.reads(first_holds, first),
        Reading(
            f"1 - C has two slopes, C = (2 kappa s + 1)/(kappa s + 1)^2 with kappa = {kappa:.3g} s instead of (6)",
            second_holds,
            second_said,
            "beside",
        ),
    )
    return Claim(
        sentence=sentence,
        readings=readings,
        shows=f"With filters chosen for equal delay margins and Gamma = {GAMMA:g}, L1-AC's tail error at size 1 is "
        f"{at_one(l1 / pi):.2g} times the PI's if C is (6) and {at_one(second / pi):.2g} times if 1 - C has two slopes.",
        measured=        "; ".join(f"{reading.says}: {reading.measured}" for reading in readings) + ". In the limit of fast "
        f"adaptation L1-AC is a linear loop with S = 1 - C. At low frequencies S has one slope if C is (6), and two slopes, as "
        f"many as with the PI, if C'(0) = 0; the left side of Theorem 1's condition is then {condition:.2f}",
        how=f"as in adaptive-against-linear, without a delay; all designs have a delay margin of {1e3 * margin:.0f} ms at "
        "Section V's theta",
        listings=(_over_sizes(l1, second, pi),),
        would_change="a different C, as the readings show, a different design of the PI, or a different delay margin or command",
    )  # fmt: skip


def _over_sizes(l1: Array, second: Array, pi: Array) -> Listing:
    told = slice(None, None, 3)  # a factor of two from row to row
    return table(
        "Tail errors max |e| against the size of the uncertainty; a dash marks a loop that diverged",
        {
            "size": SIZES[told],
            "L1-AC, C of first order": l1[told],
            "L1-AC, C'(0) = 0": second[told],
            "PI": pi[told],
        },
    )


def _compared(l1: Array, pi: Array) -> tuple[bool, str]:
    """Return whether L1-AC's errors are smaller at every size that both tolerate, and a phrase with the ratios."""
    both = ~(np.isnan(l1) | np.isnan(pi))
    ratio = l1[both] / pi[both]
    return (
        bool((ratio < 1).all()),
        f"its tail error is {ratio.min():.2g} to {ratio.max():.2g} times the PI's over the sizes that both tolerate, and "
        f"{at_one(l1 / pi):.2g} times at size 1",
    )


T_END, STEP = 60.0, 1e-4
CORNER = np.array([5.0, 5.0])
"""The corner of Section V's set in whose direction the linear loops are weakest according to mu. The plant is unstable there
from size 0.2 on."""
SIZES = 0.25 * 2.0 ** (np.arange(24) / 3)
"""Sizes of the set and of theta in it, up to 51 times those of Section V. Their number is a multiple of the kernel's lanes."""


def given(size: float, delay: float = 0.0) -> Problem:
    """Return the problem with the set and the true parameters scaled by this factor, and the parameters in the set's corner."""
    box = ParameterBox(lower=-size * np.array([5.0, 5.0]), upper=size * np.array([5.0, 5.0]))
    return variant(theta=size * CORNER, box=box, input=PlantInput(delay=delay) if delay else None)


def tail(members: list[tuple[Problem, Controller]], step: float = STEP) -> Array:
    """Return the tail error max |e| of each run, NaN if it diverged."""
    return figures(members, T_END, step).tail_max_abs_e.max(axis=1)


def over_sizes(controller: Controller) -> Array:
    """Return (sizes + 1) tail errors: one for each of SIZES and, last, the error at the theta of Section V."""
    return tail([*((given(size), controller) for size in SIZES), (variant(), controller)])


def at_one(values: Array) -> float:
    """Return the value at size 1 from values over SIZES."""
    return float(values[np.argmin(np.abs(SIZES - 1))])
