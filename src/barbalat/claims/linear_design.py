"""What the paper leaves out: the same plant family under linear robust design, adaptive schemes beside it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from barbalat.certificates.certify import certify
from barbalat.claims import section_v
from barbalat.claims.claim import Axis, Chart, Claim, Curve, Listing, verdict
from barbalat.claims.variants import figures, variant
from barbalat.controllers import LinearFeedback, Mrac
from barbalat.design import hinf_feedback, pi_feedback
from barbalat.problem.actuation import PlantInput
from barbalat.problem.known_set import ParameterBox
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError

T_END, STEP = 60.0, 1e-4
CORNER = np.array([5.0, 5.0])
"""Of Section V's set: the direction in which mu finds the linear loops weakest. It makes the plant unstable from size 0.2 on."""
SIZES = 0.25 * 2.0 ** (np.arange(24) / 3)
"""Of the set and of theta in it, up to 51 times Section V's; a multiple of the kernel's lanes."""
DELAY = 0.01
DELAYS = np.geomspace(2e-3, 0.1, 24)
PI_DELAY, HINF_DELAY = 0.0118, 0.025
"""Unmodelled delays for which the two designs get L1-AC's delay margin of 33 ms at Section V's theta, and no less."""
HINF_FAST_DELAY = 0.01
UNFOLLOWED_SHARE = 0.2
"""A controller that leaves a fifth of the model's amplitude as error no longer follows it."""


UNSTABLE_ERROR_FACTOR = 10.0
"""An error of so many times the model's amplitude is no tracking error any more: the loop is unstable."""


@dataclass(frozen=True)
class Contestant:
    """A controller in the comparison."""

    controller: Controller

    @property
    def name(self) -> str:
        return self.controller.name

    @property
    def linear(self) -> bool:
        return isinstance(self.controller, LinearFeedback)


@dataclass(frozen=True, eq=False)
class Measured:
    """Tail errors max |e|: over SIZES at the corner, without and with DELAY (NaN: diverged), and at Section V's own theta."""

    plain: Array
    delayed: Array
    at_paper: float
    largest_delay: float


def claims() -> list[Claim]:
    """Both rows; without the extra ``robust`` they are about the PI controller alone, and say so."""
    contestants, missing = _contestants()
    measured = {c.name: _measure(c.controller) for c in contestants}
    return [_adaptive_against_linear(contestants, measured, missing), _l1_against_pi(measured)]


def _contestants() -> tuple[list[Contestant], str]:
    known = section_v.problem().known
    controllers: list[Controller] = [
        Mrac(gamma=section_v.MODERATE_GAIN, name="MRAC, Γ = 10"),
        section_v.l1("L1-AC, Γ = 100, κ = 0.02 s", 100.0),
        section_v.robust_mrac("Robust MRAC, τ = 0.5 s"),
        section_v.robust_mrac("Robust MRAC, τ = 0.02 s", 0.02),
        pi_feedback(known, unmodelled_delay=PI_DELAY, name="PI"),
    ]
    missing = ""
    try:
        controllers += [
            hinf_feedback(known, unmodelled_delay=HINF_DELAY, name="H∞"),
            hinf_feedback(known, unmodelled_delay=HINF_FAST_DELAY, name="H∞, for 10 ms"),
        ]
    except InputError as error:
        missing = f". The H∞ designs are left out: {error}"
    return [Contestant(controller) for controller in controllers], missing


def _given(size: float, delay: float = 0.0) -> Problem:
    box = ParameterBox(lower=-size * np.array([5.0, 5.0]), upper=size * np.array([5.0, 5.0]))
    return variant(theta=size * CORNER, box=box, input=PlantInput(delay=delay) if delay else None)


def _tail(members: list[tuple[Problem, Controller]], step: float = STEP) -> Array:
    return figures(members, T_END, step).tail_max_abs_e.max(axis=1)


def _measure(controller: Controller) -> Measured:
    plain = _tail([*((_given(size), controller) for size in SIZES), (variant(), controller)])
    with_delays = [_given(size, DELAY) for size in SIZES] + [variant(input=PlantInput(delay=float(d))) for d in DELAYS]
    delayed, borne = np.split(_tail([(problem, controller) for problem in with_delays]), [len(SIZES)])
    lost = np.flatnonzero(~(borne < UNFOLLOWED_SHARE * amplitude()))
    last = int(lost[0]) if len(lost) else len(DELAYS)
    return Measured(plain[:-1], delayed, float(plain[-1]), float(DELAYS[last - 1]) if last else 0.0)


def amplitude() -> float:
    """Of x_m,1 in the steady state: 50 |k_0/(s^2 + s + 0.3)| at 0.5 rad/s."""
    return float(50 * 4 / abs((0.5j) ** 2 + 0.5j + 0.3))


def _adaptive_against_linear(contestants: list[Contestant], measured: dict[str, Measured], missing: str) -> Claim:
    def best(part: str, *, linear: bool) -> Array:
        errors = [getattr(measured[c.name], part) for c in contestants if c.linear is linear]
        return np.min([np.where(np.isnan(e), np.inf, e) for e in errors], axis=0)

    wins, always, conditions = True, True, []
    for part, words in (("plain", "without the delay"), ("delayed", "with it")):
        linear = best(part, linear=True)
        alive = np.isfinite(linear)
        wins &= bool((best(part, linear=False)[alive] < linear[alive]).all())
        better = {}
        for c in contestants:
            error = getattr(measured[c.name], part)
            better[c.name] = bool((np.where(np.isnan(error), np.inf, error)[alive] < linear[alive]).all())
        adaptive = [c.name for c in contestants if not c.linear]
        always &= all(better[name] for name in adaptive)
        true, false = (", ".join(name for name in adaptive if better[name] is which) or "none" for which in (True, False))
        conditions.append(f"{words} at every size of {true}, not of {false}")
    sentences = [
        f"{c.name} {measured[c.name].at_paper:.2g}, {_at_one(measured[c.name].plain):.2g} and {_at_one(measured[c.name].delayed):.2g}"
        for c in contestants
    ]
    return Claim(
        "adaptive-against-linear", "not in the paper: the comparison that its Section IV asks for", "On Section V's family adaptive schemes track better than linear robust designs",
        verdict(holds=wins, conditional=not always),
        f"tail error at the paper's theta, at the set's corner (5, 5), and there with an input delay of {1e3 * DELAY:g} ms: " + "; ".join(sentences)
        + f". Better than the best linear design {'; '.join(conditions)}. The model's amplitude is {amplitude():.0f}{missing}",
        f"Section V's command, RK4, h = {STEP:g} s, {T_END:g} s, set and theta scaled together by {len(SIZES)} sizes; half the step changes the errors by "
        f"{_step_effect(contestants, measured):.1g} of themselves (size 1, with the delay). PI and H∞ are designed to L1-AC's delay margin, H∞ for 10 ms to that delay",
        (_chart("linear-design", contestants, measured, "plain"), _chart("linear-design-delay", contestants, measured, "delayed")),
        (_table(contestants, measured),),
    )  # fmt: skip


def _at_one(values: Array) -> float:
    return float(values[np.argmin(np.abs(SIZES - 1))])


def _step_effect(contestants: list[Contestant], measured: dict[str, Measured]) -> float:
    """The largest relative change of the errors at size 1 with the delay when the step is halved."""
    given = _given(1.0, DELAY)
    fine = {c.name: float(_tail([(given, c.controller)], STEP / 2)[0]) for c in contestants}
    return max(abs(_at_one(measured[c.name].delayed) / fine[c.name] - 1) for c in contestants)


def _chart(key: str, contestants: list[Contestant], measured: dict[str, Measured], part: str) -> Chart:
    delayed = part == "delayed"
    level = Curve("a fifth of the model's amplitude", [SIZES[0], SIZES[-1]], [UNFOLLOWED_SHARE * amplitude()] * 2)
    return Chart(
        key=key,
        title="Section V's family as its parameters grow" + (f", with an input delay of {1e3 * DELAY:g} ms" if delayed else ""),
        caption="Set and true parameters scaled together, the parameters in the set's corner (5, 5), where mu finds the linear loops "
        "weakest; fixed settings of all controllers. " + ("An exact delay at the input, which no controller knows" if delayed else "Without modelling errors"),
        x=Axis("size of the parameters (1: Section V)", SIZES, logarithmic=True),
        quantity="max |e| in the tail",
        lost=f"last size before |e| passes {UNSTABLE_ERROR_FACTOR:g} amplitudes",
        curves=tuple(_until_lost(c.name, getattr(measured[c.name], part)) for c in contestants),
        levels=(level,),
    )  # fmt: skip


def _until_lost(label: str, errors: Array) -> Curve:
    lost = np.flatnonzero(~(errors < UNSTABLE_ERROR_FACTOR * amplitude()))
    end = int(lost[0]) if len(lost) else len(errors)
    return Curve(label, SIZES[:end], errors[:end])


def _table(contestants: list[Contestant], measured: dict[str, Measured]) -> Listing:
    found = certify(section_v.problem(), tuple(c.controller for c in contestants), Simulation(t_end=T_END, dt=STEP))
    rows = []
    for c in contestants:
        v, m = found[c.name].values, measured[c.name]
        rows.append((
            c.name,
            *(_shown(v.get(key), factor) for key, factor in (("delay_margin", 1e3), ("sensitivity_peak", 1), ("complementary_sensitivity_peak", 1))),
            _shown(v.get("parameter_scale"), round_off=math.floor), _shown(v.get("error_bound"), round_off=math.ceil),
            f"{1e3 * m.largest_delay:.2g}", f"{m.at_paper:.2g}", _lost_from(m.plain), _lost_from(m.delayed),
        ))  # fmt: skip
    return Listing(
        "Margins and peaks: exact, of the linear loop that the scheme is or becomes (MRAC and robust MRAC: estimates at rest on theta; L1-AC: "
        "limit of fast adaptation). mu: exact at the frequencies tried. Bound: guaranteed, over the set. Simulated: the last four columns; "
        f"a controller follows while its tail error stays below {UNFOLLOWED_SHARE:g} of the model's amplitude",
        (
            "controller", "delay margin [ms]", "Ms", "Mt", "set may grow by 1/mu", "bound of |e|", "delay borne [ms]",
            "tail error", "follows below size", f"with {1e3 * DELAY:g} ms",
        ),
        tuple(rows),
    )  # fmt: skip


def _shown(value: Any, factor: float = 1.0, round_off: Callable[[float], float] = round) -> str:
    """Three digits; a bound is rounded to its safe side, up or down."""
    if value is None:
        return "-"
    unit = 10.0 ** (math.floor(math.log10(factor * value)) - 2)
    return f"{round_off(factor * value / unit) * unit:.3g}"


def _lost_from(errors: Array) -> str:
    lost = np.flatnonzero(~(errors < UNFOLLOWED_SHARE * amplitude()))
    return f"{SIZES[lost[0]]:.2g}" if len(lost) else f"more than {SIZES[-1]:.2g}"


def _l1_against_pi(measured: dict[str, Measured]) -> Claim:
    l1, pi = (next(m for name, m in measured.items() if name.startswith(start)) for start in ("L1", "PI"))
    both = ~(np.isnan(l1.plain) | np.isnan(pi.plain))
    ratio = l1.plain[both] / pi.plain[both]
    return Claim(
        "l1-against-pi", "not in the paper: the comparison that its Section IV asks for", "L1-AC tracks better than a PI controller with as large a delay margin",
        verdict(holds=bool((ratio < 1).all()), conditional=False),
        f"its tail error is {ratio.min():.2g} to {ratio.max():.2g} times the PI's over the sizes that both bear; as a linear loop in the limit of fast adaptation it "
        "has S = 1 - C, one slope of rejection where the PI has two",
        "as above; both with a delay margin of 33 ms at Section V's theta",
    )  # fmt: skip
