"""The claim that the filter reduces the robust stability margins whatever the adaptive gain, in all its readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from barbalat.certificates.linear_loops.ideal import around_equilibrium, fast_adaptation, known_parameters
from barbalat.controllers import L1Adaptive, Mrac
from barbalat.judge.settings import Judge
from barbalat.linear.margins import margins
from barbalat.linear.systems import TransferFunction, input_filter
from barbalat.papers.claim import Claim, Listing, Measurement
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.filter.adapting_margins import GAINS, KAPPAS, MARGINS, TOLD_GAINS, changed, filter_effect, loop
from barbalat.papers.jafari_2013.filter.adapting_margins import METHOD as EXACT
from barbalat.papers.jafari_2013.section_v import variant
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.problem.actuation import PlantInput
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller, Signal
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.signals import Constant, Sine
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import delay_margins_ensemble
from barbalat.study.verdicts import Lost, Verdicts
from barbalat.validate import Array

SIMULATION = Simulation(t_end=40.0, dt=2e-4)
"""Three periods of the command."""
COMMANDS: dict[str, Signal] = {"r = sin 0.5t": Sine(1.0, 0.5), "r = 50 sin 0.5t": Sine(50.0, 0.5), "r = 50": Constant(50.0)}
EQUAL_GAINS = (0.01, 1.0, 100.0)
OWN_GAINS = (10.0, 100.0)
"""What a user would choose at this step: MRAC's moderate one, and for L1-AC the largest decade that the step resolves at r = 50."""
SEARCHED_GAINS = np.geomspace(1e-6, 10.0, 36)
"""Of MRAC, five a decade: one of them tracks as L1-AC does."""
BANDWIDTHS = np.geomspace(0.2, 2000.0, 54)
"""[rad/s] of the actuator, from slower than the model to faster than the step resolves."""
DAMPING = 0.7
"""Of the actuator: a maximally flat second order has 0.707."""
JUDGE, LOSS = Judge(), Lost()


class Simulated(NamedTuple):
    """What the loop bears without and with the filter, by each criterion, (2,) each."""

    command: str
    what: str
    onset: Array
    loss: Array


def claim() -> Claim:
    """Exact margins of the linear loops, and simulated ones of the adapting loops in each reading."""
    given = section_v.problem()
    plant, C = given.plant, input_filter(section_v.KAPPA).realise()
    slow = [margins(loop).delay for loop in (known_parameters(plant, plant.theta), known_parameters(plant, plant.theta, C))]
    fast = margins(fast_adaptation(plant, C)).delay
    adapting = [adapting_delay_margin(c, 1.0) for c in (Mrac(gamma=100.0), section_v.l1("L1", 100.0))]
    found = [each for name, signal in COMMANDS.items() for each in _simulated(name, signal)]
    effect = filter_effect()
    always, between = ", ".join(effect.fall_at_every_gain) or "none", TOLD_GAINS[1]
    counter = f"at Gamma r^2 = {between:g} the delay margin goes from {changed('delay margin', between)} s"
    readings = (
        SENTENCES["filter-reduces-margins"].reads(
            len(effect.fall_at_every_gain) == len(MARGINS),
            f"{counter}; at every gain that was tried only this falls: {always}; at the highest gain these rise: {', '.join(effect.rise_at_high_gain) or 'none'}",
        ),
        *effect.readings,
        _at_rest(slow),
        _reading("until the loop begins to oscillate: simulated delays and actuators", found, "onset"),
        _reading("until the motion is lost, oscillations or not: simulated delays and actuators", found, "loss"),
    )
    return Claim(
        sentence=SENTENCES["filter-reduces-margins"],
        readings=readings,
        shows=f"At every gain only this falls: {always} ({effect.gain_margins[0]:.4g} to {effect.gain_margins[1]:.4g} in Figure 3). "
        f"At Gamma r^2 = {between:g} the delay margin is {_times(between):.2g} times as large with the filter.",
        measured=f"exact: the filter changes the delay margin from {_change(slow)} with the estimates at rest on theta, from {_change(adapting)} with "
        f"the law working at Gamma = 100 around r = 1; for Gamma to infinity it is {fast:.3g} s with the filter, while without it the margin "
        f"falls as 1/Gamma. Its gain margin falls from {effect.gain_margins[0]:.4g} to {effect.gain_margins[1]:.4g} at Figure 3's gain. Simulated in {len(found)} readings. Until the loop "
        f"begins to oscillate: {_counted(found, 'onset')}. Until the motion is lost, oscillations or not: {_counted(found, 'loss')}",
        how=f"kappa = 0.02 s. {EXACT}; {len(GAINS)} x {len(KAPPAS)} values of Gamma r^2 and kappa, the limit by root finding. Simulated: Section V, RK4, h = 2e-4 s, 40 s: the "
        "exact delay [s] that the loop bears, by scan and bisection, and the smallest natural frequency [rad/s] of a second-order actuator with damping 0.7, as its inverse [s]. Onset: "
        "the judge calls the run lost or a limit cycle, or its oscillation grows without end. Loss: lost, or the error in the tail grew by the "
        "largest |x_m|. At equal gain Gamma = 0.01, 1, 100; at own gain 10 and 100; at equal error the MRAC's Gamma gives the RMS error that "
        "L1-AC has at 100",
        maps=effect.maps,
        listings=(_listing(found),),
        would_change="holds: phase, delay and small-gain margins that the filter lowers at high gain too, and a downward gain margin that it lowers at every gain",
    )  # fmt: skip


def _times(gain: float) -> float:
    """The delay margin with Section V's filter over that without, at this Gamma r^2."""
    plain, filtered = (margins(loop(kappa)(gain)).delay for kappa in (None, section_v.KAPPA))
    return filtered / plain


def _reading(says: str, found: Sequence[Simulated], criterion: str) -> Reading:
    always = all(change(getattr(each, criterion)) == "down" for each in found)
    return Reading(says, always, _counted(found, criterion), "beside")


EQUAL_MARGINS_RATIOS = 0.98, 1.02
"""Ratios between which two margins count as the same: the bisection's resolution."""


def change(pair: Array) -> str:
    """What the filter does to a margin; 0 stands for one that is too small to be tried."""
    without, filtered = pair
    if without == filtered == 0:
        return "none"
    return (
        "up"
        if filtered > without * EQUAL_MARGINS_RATIOS[1]
        else "down"
        if filtered < without * EQUAL_MARGINS_RATIOS[0]
        else "same"
    )


def _counted(readings: Sequence[Simulated], criterion: str) -> str:
    """How often the filter raises and lowers the margin, in all and in each kind of reading."""

    def counts(some: Sequence[Simulated]) -> str:
        found = [change(getattr(reading, criterion)) for reading in some]
        texts = {"up": "up in", "same": "within 2 % in", "none": "too small to be seen on both sides in", "down": "down in"}
        return ", ".join(f"{text} {found.count(key)}" for key, text in texts.items() if key in found)

    kinds = {"at equal gain": "Gamma", "at own gains": "own gains", "at equal error": "equal error"}
    parts = [f"{kind} {counts([r for r in readings if key in r.what])}" for kind, key in kinds.items()]
    return f"{counts(readings)} ({'; '.join(parts)})"


def _listing(readings: Sequence[Simulated]) -> Listing:
    return Listing(
        "What the loop bears without and with the filter, until it begins to oscillate (onset) and until the motion is lost (loss): the "
        "largest delay [s], or the slowest actuator as the inverse of its natural frequency [s]; 0: less than was tried",
        ("command", "reading", "onset: without", "with filter", "", "loss: without", "with filter", ""),
        tuple((r.command, r.what, *_shown(r.onset), *_shown(r.loss)) for r in readings),
    )


def _shown(pair: Array) -> tuple[str, str, str]:
    found = change(pair)
    return f"{pair[0]:.3g}", f"{pair[1]:.3g}", found if found in ("up", "down") else ""


def _change(pair: list[float]) -> str:
    without, with_filter = pair
    return f"{without:.3g} to {with_filter:.3g} s ({_way(pair)})"


def _way(pair: Sequence[float]) -> str:
    return "up" if pair[1] > pair[0] else "down"


def adapting_delay_margin(controller: Mrac | L1Adaptive, r: float) -> float:
    """Exact, of the loop linearised with its law at the constant command r [s]."""
    return margins(around_equilibrium(section_v.problem(), controller, r)).delay


def _simulated(command: str, signal: Signal) -> list[Simulated]:
    """Delays and actuators under one command."""
    problem = variant(reference=signal)
    gains = [*EQUAL_GAINS, OWN_GAINS[0], _equal_error(signal)]
    filtered_gains = [*EQUAL_GAINS, OWN_GAINS[1], OWN_GAINS[1]]
    names = [*(f"Gamma {gain:g}" for gain in EQUAL_GAINS), "own gains", "equal error"]
    groups = [Mrac(gamma=g) for g in gains], [section_v.l1("L1", g) for g in filtered_gains]
    delays = [delay_margins_ensemble([(problem, c) for c in group], SIMULATION, resolution=0.05) for group in groups]
    actuators = [_actuator_margins(problem, group) for group in groups]
    found = []
    for what, onset, loss in (
        ("delay", [d.onset.bears for d in delays], [d.loss.bears for d in delays]),
        ("actuator", [a["onset"] for a in actuators], [a["loss"] for a in actuators]),
    ):
        found += [
            Simulated(command, f"{what}, {name}", np.array([part[i] for part in onset]), np.array([part[i] for part in loss]))
            for i, name in enumerate(names)
        ]
    return found


def _equal_error(signal: Signal) -> float:
    """The MRAC's gain with the RMS error of L1-AC at its own gain, the nearest of a fine grid."""
    problem = variant(reference=signal)
    target = _rms([(problem, section_v.l1("L1", OWN_GAINS[1]))])[0]
    found = _rms([(problem, Mrac(gamma=float(g))) for g in SEARCHED_GAINS])
    return float(SEARCHED_GAINS[np.nanargmin(np.abs(np.log(found / target)))])


def _rms(members: list[tuple[object, Controller]]) -> Array:
    return np.asarray(np.linalg.norm(simulate_ensemble(members, SIMULATION).metrics.rms_e, axis=1))  # type: ignore[arg-type]


def _actuator_margins(problem: Problem, controllers: Sequence[Controller]) -> dict[str, Array]:
    """For each controller, by each criterion, 1/w of the slowest actuator above which none is lost [s]; 0 where none is borne."""
    slowed = [
        replace(problem, plant=replace(problem.plant, input=PlantInput(actuator=TransferFunction([w**2], [1.0, 2 * DAMPING * w, w**2]))))
        for w in BANDWIDTHS
    ]  # fmt: skip
    without = Verdicts.run([(problem, c) for c in controllers], SIMULATION, JUDGE)
    found = Verdicts.run([(p, c) for c in controllers for p in slowed], SIMULATION, JUDGE)
    lost = LOSS.judge(found, without.of(np.repeat(np.arange(len(controllers)), len(slowed)))).reshape(len(controllers), -1)
    begun = found.oscillates.reshape(lost.shape) | lost | without.oscillates[:, None]
    return {"onset": np.array([_slowest(row) for row in begun]), "loss": np.array([_slowest(row) for row in lost])}


def _slowest(lost: Array) -> float:
    """1/w of the smallest natural frequency above the last that is lost [s]."""
    first = np.flatnonzero(lost)[-1] + 1 if lost.any() else 0
    return 1 / float(BANDWIDTHS[first]) if first < len(BANDWIDTHS) else 0.0


def _at_rest(delays: list[float]) -> Reading:
    return Reading(
        "the delay margin of the loop with its estimates at rest on theta: exact",
        delays[1] < delays[0],
        f"{delays[0]:.3g} to {delays[1]:.3g} s",
        "beside",
    )


ROWS = (Measurement(claim, 9.0, {"filter-reduces-margins": "the filter reduces the margins"}, place=220, shares="scans"),)
