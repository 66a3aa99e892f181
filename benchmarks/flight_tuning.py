"""Find the settings in ``vehicles/f16/schemes.py`` and ``vehicles/quadrotor/schemes.py``: tune every scheme by the contest's
rule.

    python -m benchmarks.flight_tuning [f16-pitch|f16-roll|quadrotor] [SCHEME ...]

Without SCHEME it tunes all of them and writes docs/guides/tuned-NAME.txt. The quadrotor's part is in
``quadrotor_tuning``.

The F-16's plant is the linear model of one axis at 10,013 ft and Mach 0.525, behind the actuator and the delay of transport and
sensors. It follows the flights' command. From ``OFF_AT`` on the trim of its surface is wrong by ``TRIM_OFF``, as after a failure.
The rule is the least RMS error with at least the delay margin and the gain margin below, and the same number of trials for all
schemes.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from barbalat import Simulation, TransferFunction
from barbalat.cases.build import Case
from barbalat.comparison.contest.entrant import Entrant
from barbalat.comparison.contest.rule import Rule
from barbalat.comparison.contest.tuned import Qualified, qualify
from barbalat.comparison.search.aim import Plants
from barbalat.controllers.tuning_grid import TuningGrid
from barbalat.judge.settings import Judge
from barbalat.problem.actuation import PlantInput
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.signals import Step
from barbalat.study.verdicts import Criterion
from barbalat.vehicles.f16.axis import Axis
from barbalat.vehicles.f16.schemes import SCHEMES
from barbalat.vehicles.quadrotor.schemes import SCHEMES as QUADROTOR_SCHEMES
from barbalat.vehicles.vehicle import vehicle_of
from benchmarks import quadrotor_tuning

DELAY_MARGIN, GAIN_MARGIN = 0.1, 2.0
"""Delay margin [s], which is 45 deg of phase at a crossover of 8 rad/s, and a gain margin of 6 dB. MIL-F-9490D requires both for
flight control systems."""
TRIM_OFF, OFF_AT = 1.0, 6.0
"""Trim error [deg] of the surface, between the trims for half an elevator and for a centre of gravity that is 5 % of the chord
further aft; its instant [s]."""
SIMULATION = Simulation(t_end=10.0, dt=0.0025)
RULE = Rule(delay_margin=DELAY_MARGIN, gain_margin=GAIN_MARGIN, until=Criterion.LOSS, plants=1, trials=288)
KNOB_VALUES = 24


def as_linearised(axis: Axis, problem: Problem) -> Problem:
    """The problem of an axis with its equipment, its command and a wrong trim."""
    equipment = axis.equipment
    path = PlantInput(
        saturation=axis.travel,
        actuator=TransferFunction([1.0], [equipment.actuator_lag, 1.0]),
        delay=equipment.transport_delay + equipment.sensor_lag,
    )
    plant = replace(problem.plant, input=path)
    return replace(problem, plant=plant, reference=axis.followed.command, disturbance=Step(amplitude=TRIM_OFF, start=OFF_AT))


def tuned(axis: Axis, scheme: str) -> Qualified:
    """The result of the rule for one scheme."""
    contestant = SCHEMES[scheme]

    def made(**numbers: float) -> Controller:
        return contestant.make(axis, numbers).controller

    values = {knob: np.geomspace(low, high, KNOB_VALUES) for knob, (low, high) in contestant.knobs.items()}
    least = {knob: float(tried[0]) for knob, tried in values.items()}
    entrant = Entrant(knobs=TuningGrid(scheme=scheme, values=values, make=made))
    problem = as_linearised(axis, contestant.make(axis, least).problem)
    plants = Plants.of(Case(problem, (made(**least),), SIMULATION), RULE.aim, [problem])
    return qualify(entrant, RULE, plants, SIMULATION, judge=Judge())


PAGES = Path(__file__).parents[1] / "docs" / "guides"
HEADS = ("scheme", "numbers", "RMS e", "tolerated delay [ms]", "over required", "gain up", "gain down")


def row(scheme: str, found: Qualified, rule: Rule) -> list[str]:
    """A row of the table: numbers to three digits, with an asterisk at the end of a range; the margins; and the ratio of the
    delay margin to the required one."""
    margins = found.margins[rule.until]
    numbers = [f"{knob} {value:.3g}{'*' * (knob in found.at_edge)}" for knob, value in found.tuning.items()]
    kept = "" if found.meets else ", breaks the rule"
    factors = (f"{one:.3g}" for one in (margins.delay / rule.delay_margin, margins.gain_up, margins.gain_down))
    return [f"`{scheme}`", f"{', '.join(numbers) or 'none'}{kept}", f"{found.error:.3g}", f"{1e3 * margins.delay:.0f}", *factors]


def table(rows: Iterable[Sequence[str]], heads: Sequence[str] = HEADS) -> str:
    """The table in Markdown."""
    return "".join(f"| {' | '.join(cells)} |\n" for cells in (heads, ["---"] * len(heads), *rows))


def of_aircraft(name: str, chosen: Sequence[str]) -> Iterator[list[str]]:
    """The rows of one axis of the F-16."""
    nominal = vehicle_of(name).nominal()
    for scheme in chosen or SCHEMES:
        yield row(scheme, tuned(nominal, scheme), RULE)


def of_quadrotor(chosen: Sequence[str]) -> Iterator[list[str]]:
    """The rows of the quadrotor's axes that differ, each with the axis in the first column."""
    axes = vehicle_of("quadrotor").nominal()
    for axis in (axes.attitude[0], axes.attitude[2], axes.position[0]):
        rule = quadrotor_tuning.rule_of(axes, axis, RULE.trials)
        for scheme in chosen or QUADROTOR_SCHEMES:
            yield [axis.like, *row(scheme, quadrotor_tuning.tuned(axes, axis, scheme, rule), rule)]


def shown(rows: Iterable[list[str]]) -> list[list[str]]:
    """The rows, each printed as it is found."""
    found = []
    for one in rows:
        print(*one, sep="  ", flush=True)
        found.append(one)
    return found


if __name__ == "__main__":
    name, *chosen = sys.argv[1:] or ["f16-pitch"]
    heads = ("axis", *HEADS) if name == "quadrotor" else HEADS
    rows = shown(of_quadrotor(chosen) if name == "quadrotor" else of_aircraft(name, chosen))
    if not chosen:
        (PAGES / f"tuned-{name}.txt").write_text(table(rows, heads))
