"""The claim that the filter reduces the robust stability margins whatever the adaptive gain, in all its readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from barbalat.certificates.linear_loops.ideal import around_equilibrium, fast_adaptation, known_parameters
from barbalat.controllers import L1Adaptive, Mrac
from barbalat.judge.settings import Judge
from barbalat.linear.margins import margins
from barbalat.linear.systems import TransferFunction, input_filter, two_slopes
from barbalat.papers.claim import Claim, Listing, Measurement
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.filter import equal_error
from barbalat.papers.jafari_2013.filter.adapting_margins import GAINS, KAPPAS, MARGINS, TOLD_GAINS, changed, filter_effect
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
"""A simulation over three periods of the command."""
SMALL_COMMAND = "r = sin 0.5t"
COMMANDS: dict[str, Signal] = {SMALL_COMMAND: Sine(1.0, 0.5), "r = 50 sin 0.5t": Sine(50.0, 0.5), "r = 50": Constant(50.0)}
SIDES_SIMULATION = Simulation(t_end=40.0, dt=4e-4)
"""The simulation of the many tunings at equal error. With its step, h omega_a is 0.5 at the largest gain and r = 50."""
EQUAL_GAINS = (0.01, 1.0, 100.0)
OWN_GAINS = (10.0, 100.0)
"""Gains that a user would choose with this step: a moderate one for MRAC, and for L1-AC the largest power of ten that the step
resolves at r = 50."""
SEARCHED_GAINS = np.geomspace(1e-6, 10.0, 36)
"""Gains of MRAC, five per decade. At one of these gains MRAC tracks as well as L1-AC."""
BANDWIDTHS = np.geomspace(0.2, 2000.0, 54)
"""Natural frequencies of the actuator [rad/s], from slower than the model to faster than the step resolves."""
DAMPING = 0.7
"""Damping ratio of the actuator. A maximally flat second-order lag has 0.707."""
JUDGE, LOSS = Judge(), Lost()


TWO_SLOPES = "two slopes"


class Simulated(NamedTuple):
    """The tolerated values without and with the filter, (2,) for each criterion."""

    command: str
    what: str
    onset: Array
    loss: Array


def claim(*, full: bool = False) -> Claim:
    """Measure exact margins of the linear loops, and simulated ones of the adapting loops in each reading."""
    given = section_v.problem()
    plant, C = given.plant, input_filter(section_v.KAPPA).realise()
    slow = [margins(loop).delay for loop in (known_parameters(plant, plant.theta), known_parameters(plant, plant.theta, C))]
    fast = margins(fast_adaptation(plant, C)).delay
    adapting = [adapting_delay_margin(c, 1.0) for c in (Mrac(gamma=100.0), section_v.l1("L1", 100.0))]
    found = [each for name, signal in COMMANDS.items() for each in _simulated(name, signal)]
    count = equal_error.MORE if full else equal_error.BUDGET
    sides = [equal_error.fronts(name, signal, SIDES_SIMULATION, count) for name, signal in COMMANDS.items()]
    effect = filter_effect()
    always, between = ", ".join(effect.fall_at_every_gain) or "none", TOLD_GAINS[1]
    counter = f"at Gamma r^2 = {between:g} the delay margin goes from {changed('delay margin', between)} s"
    readings = (
        SENTENCES["filter-reduces-margins"].reads(
            len(effect.fall_at_every_gain) == len(MARGINS),
            f"{counter}; falling at every gain tried: {always}; rising at the highest gain: "
            f"{', '.join(effect.rise_at_high_gain) or 'none'}",
        ),
        *effect.readings,
        _at_rest(slow),
        _reading(
            "the filter lowers the simulated margins (the tolerated delays and actuators) up to the beginning of an oscillation",
            found,
            "onset",
        ),
        _reading(
            "the filter lowers the simulated margins (the tolerated delays and actuators) up to the loss of the motion, with or "
            "without oscillations",
            found,
            "loss",
        ),
        _at_large_commands(found),
        *(equal_error.reading(sides, criterion) for criterion in equal_error.CRITERIA),
    )
    return Claim(
        sentence=SENTENCES["filter-reduces-margins"],
        readings=readings,
        shows=f"At every gain only these fall: {always} ({effect.gain_margins[0]:.4g} to {effect.gain_margins[1]:.4g} in Figure 3). "
        f"{_at_equal_error(found)}",
        measured=f"exact: the filter changes the delay margin from {_change(slow)} with the estimates fixed at theta and from "
            f"{_change(adapting)} with the law active at Gamma = 100 around r = 1. As Gamma tends to infinity, the margin is "
            f"{fast:.3g} s with the filter and falls as 1/Gamma without it. Its gain margin falls from "
            f"{effect.gain_margins[0]:.4g} to {effect.gain_margins[1]:.4g} at Figure 3's gain. The simulated margins in "
            f"{len(found)} readings are as follows. Up to the beginning of an oscillation: "
            f"{_counted(found, 'onset')}. Up to the loss of the motion, with or without oscillations: {_counted(found, 'loss')}",
        how=f"kappa = 0.02 s. {EXACT}; {len(GAINS)} x {len(KAPPAS)} values of Gamma r^2 and kappa, the limit by root finding. "
        f"Simulated: Section V, RK4, h = 2e-4 s, 40 s. Scan and bisection find the largest exact delay [s] that the loop "
        f"tolerates, and the smallest natural frequency [rad/s] of a second-order actuator with damping 0.7 (listed as its "
        f"inverse [s]). Onset: the judge finds the run lost or in a limit "
        "cycle, or its oscillation grows without bound. Loss: lost, or the error in the tail grew by the "
        "largest |x_m|. "
        f"Equal gain: Gamma = 0.01, 1, 100. Own gain: 10 and 100. Equal error: MRAC's Gamma gives the RMS error that L1-AC has "
        f"at Gamma = 100. L1-AC's filter is (6), or (2 kappa s + 1)/(kappa s + 1)^2 with kappa = "
        f"{section_v.two_slopes_kappa():.3g} s, which has the same delay margin in the limit. {equal_error.RULE}; {count} "
        f"tunings of each side, h = {SIDES_SIMULATION.dt:g} s",
        maps=effect.maps,
        listings=(_listing(found), equal_error.listing(sides)),
        sharpened=f"{equal_error.MORE} tunings of each side at equal error instead of {equal_error.BUDGET}",
        would_change="holds: a filter that reduces the phase, delay and small-gain margins even at high gain, and reduces the "
        "downward gain margin at every gain",
    )  # fmt: skip


def _at_equal_error(found: Sequence[Simulated]) -> str:
    """Return the sentence on the filter (6) at equal error, the comparison in which the filter gains nothing by a larger error."""
    earlier = [change(one.onset) == "down" for one in found if "(6)" in one.what]
    return f"At equal error with filter (6), oscillation begins earlier in {sum(earlier)} of {len(earlier)} readings."


def _reading(says: str, found: Sequence[Simulated], criterion: str) -> Reading:
    always = all(change(getattr(each, criterion)) == "down" for each in found)
    return Reading(says, always, _counted(found, criterion), "beside")


def _at_large_commands(found: Sequence[Simulated]) -> Reading:
    """Return the reading on the filter of two slopes at equal error, under the commands of size 50."""
    some = [one for one in found if TWO_SLOPES in one.what and one.command != SMALL_COMMAND]
    raised = [one for one in some if change(one.onset) == "up"]
    told = "; ".join(f"{one.command}, {one.what.split(',')[0]}: {one.onset[0]:.3g} to {one.onset[1]:.3g} s" for one in some)
    return Reading(
        f"with a filter of {TWO_SLOPES} in place of (6), at equal error and under commands of size 50, the loop begins to "
        f"oscillate earlier",
        all(change(one.onset) == "down" for one in some),
        f"oscillations begin later in {len(raised)} of {len(some)} readings: {told}",
        "beside",
    )


EQUAL_MARGINS_RATIOS = 0.98, 1.02
"""Two margins count as equal if their ratio is in this interval, which is the bisection's resolution."""


def change(pair: Array) -> str:
    """Return a word for the filter's effect on a margin. A margin of 0 is below the smallest value tried."""
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
    """Return a phrase on how often the filter raises and lowers the margin, in total and for each kind of reading."""

    def counts(some: Sequence[Simulated]) -> str:
        found = [change(getattr(reading, criterion)) for reading in some]
        texts = {
            "up": "up in",
            "same": "within 2 % in",
            "none": "too small to be measured for both schemes in",
            "down": "down in",
        }
        return ", ".join(f"{text} {found.count(key)}" for key, text in texts.items() if key in found)

    kinds = {
        "at equal gain": "Gamma",
        "at own gains": "own gains",
        "at equal error, (6)": "error, (6)",
        f"at equal error, {TWO_SLOPES}": TWO_SLOPES,
    }
    groups = {kind: [r for r in readings if key in r.what] for kind, key in kinds.items()}
    parts = [f"{kind} {counts(some)}" for kind, some in groups.items() if some]
    return f"{counts(readings)} ({'; '.join(parts)})"


def _listing(readings: Sequence[Simulated]) -> Listing:
    return Listing(
        "Tolerated delay [s] or actuator (the inverse of the smallest natural frequency [s]) without and with the filter. "
        "Onset: an oscillation begins. Loss: the motion is lost. 0 means less than the smallest value tried",
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
    """Return the exact delay margin [s] of the loop that is linearised, law included, at the constant command r."""
    return margins(around_equilibrium(section_v.problem(), controller, r)).delay


def _simulated(command: str, signal: Signal) -> list[Simulated]:
    """Simulate the tolerated delays and actuators under one command."""
    problem = variant(reference=signal)
    two = L1Adaptive(gamma=OWN_GAINS[1], filter=two_slopes(section_v.two_slopes_kappa()), name="L1")
    with_6 = [section_v.l1("L1", g) for g in (*EQUAL_GAINS, OWN_GAINS[1], OWN_GAINS[1])]
    gains = [*EQUAL_GAINS, OWN_GAINS[0], _equal_error(signal, with_6[-1]), _equal_error(signal, two)]
    names = [*(f"Gamma {gain:g}" for gain in EQUAL_GAINS), "own gains", "equal error, (6)", f"equal error, {TWO_SLOPES}"]
    sides: tuple[list[list[Controller]], ...] = ([[Mrac(gamma=g) for g in gains]], [[*with_6], [two]])  # each has one structure
    found = []
    for what, margins_of in (("delay", _delay_margins), ("actuator", _actuator_margins)):
        measured = [[margins_of(problem, group) for group in groups] for groups in sides]
        onset, loss = ([np.concatenate([one[by] for one in side]) for side in measured] for by in ("onset", "loss"))
        found += [
            Simulated(command, f"{what}, {name}", np.array([part[i] for part in onset]), np.array([part[i] for part in loss]))
            for i, name in enumerate(names)
        ]
    return found


def _delay_margins(problem: Problem, controllers: Sequence[Controller]) -> dict[str, Array]:
    """Return for each criterion and controller the largest delay that is tolerated [s]."""
    found = delay_margins_ensemble([(problem, c) for c in controllers], SIMULATION, resolution=0.05)
    return {"onset": found.onset.tolerates, "loss": found.loss.tolerates}


def _equal_error(signal: Signal, filtered: L1Adaptive) -> float:
    """Return the gain on a fine grid with which MRAC's RMS error is nearest to that of this L1-AC."""
    problem = variant(reference=signal)
    target = _rms([(problem, filtered)])[0]
    found = _rms([(problem, Mrac(gamma=float(g))) for g in SEARCHED_GAINS])
    return float(SEARCHED_GAINS[np.nanargmin(np.abs(np.log(found / target)))])


def _rms(members: list[tuple[object, Controller]]) -> Array:
    return np.asarray(np.linalg.norm(simulate_ensemble(members, SIMULATION).metrics.rms_e, axis=1))  # type: ignore[arg-type]


def _actuator_margins(problem: Problem, controllers: Sequence[Controller]) -> dict[str, Array]:
    """Return for each criterion and controller 1/w [s] of the slowest actuator such that no faster one loses the run; 0 if none
    is tolerated."""
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
    """Return 1/w [s] of the smallest natural frequency above the largest one with a lost run."""
    first = np.flatnonzero(lost)[-1] + 1 if lost.any() else 0
    return 1 / float(BANDWIDTHS[first]) if first < len(BANDWIDTHS) else 0.0


def _at_rest(delays: list[float]) -> Reading:
    return Reading(
        "the filter lowers the exact delay margin of the loop with its estimates fixed at theta",
        delays[1] < delays[0],
        f"{delays[0]:.3g} to {delays[1]:.3g} s",
        "beside",
    )


ROWS = (
    Measurement(
        claim,
        12.0,
        {"filter-reduces-margins": "the filter reduces the margins"},
        place=220,
        shares="scans",
        sharper=partial(claim, full=True),
        sharper_seconds=60.0,
    ),
)
