"""Find the numbers of ``flight/schemes.py``: every scheme under the contest's rule, on the linearised nominal aircraft.

    python -m benchmarks.flight_tuning [f16-pitch|f16-roll] [SCHEME ...]

The aircraft is the linear model of one axis at 10,013 ft and Mach 0.525 behind its actuator and a delay of its transport and its
sensors, following the flights' command; from ``OFF_AT`` on the trim of its surface is off by ``TRIM_OFF``, as after a failure.
The rule: least RMS error with the delay margin and the gain margin at least as below, equal trials for all.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from barbalat import FlightCondition, Simulation, Step, TransferFunction
from barbalat.cases.build import Case
from barbalat.contests.entrant import Entrant
from barbalat.contests.rule import Rule
from barbalat.contests.tuned import Qualified, qualify
from barbalat.controllers.knobs import Knobs
from barbalat.flight.axis import Axis
from barbalat.flight.comparison import axis_of
from barbalat.flight.schemes import SCHEMES
from barbalat.problem.actuation import PlantInput
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.study.delay_search import Criterion
from barbalat.tuning.trial import Plants

DELAY_MARGIN, GAIN_MARGIN = 0.1, 2.0
"""[s], 45 deg of phase at a crossover of 8 rad/s; 6 dB: what MIL-F-9490D asks of flight control systems."""
TRIM_OFF, OFF_AT = 1.0, 6.0
"""[deg] of the surface, between what half an elevator and what a centre of gravity by 5 % of the chord aft ask for; [s]."""
SIMULATION = Simulation(t_end=10.0, dt=0.0025)
RULE = Rule(delay_margin=DELAY_MARGIN, gain_margin=GAIN_MARGIN, until=Criterion.LOSS, plants=1, trials=288)
KNOB_VALUES = 24


def as_linearised(axis: Axis, problem: Problem) -> Problem:
    """A problem of the axis with its equipment, its command and a trim that is off."""
    equipment = axis.equipment
    path = PlantInput(
        saturation=axis.travel,
        actuator=TransferFunction([1.0], [equipment.actuator_lag, 1.0]),
        delay=equipment.transport_delay + equipment.sensor_lag,
    )
    plant = replace(problem.plant, input=path)
    return replace(problem, plant=plant, reference=axis.followed.command, disturbance=Step(amplitude=TRIM_OFF, start=OFF_AT))


def tuned(axis: Axis, scheme: str) -> Qualified:
    """What the rule gives one scheme."""
    contestant = SCHEMES[scheme]

    def made(**numbers: float) -> Controller:
        return contestant.make(axis, numbers).controller

    values = {knob: np.geomspace(low, high, KNOB_VALUES) for knob, (low, high) in contestant.knobs.items()}
    least = {knob: float(tried[0]) for knob, tried in values.items()}
    entrant = Entrant(knobs=Knobs(scheme=scheme, values=values, make=made))
    problem = as_linearised(axis, contestant.make(axis, least).problem)
    plants = Plants.of(Case(problem, (made(**least),), SIMULATION), RULE.aim, [problem])
    return qualify(entrant, RULE, plants, plants, SIMULATION)  # no sensor has noise, so that the silent plants are the same


def show(scheme: str, found: Qualified) -> None:
    """Print it."""
    margins = found.margins[RULE.until]
    numbers = ", ".join(f"{knob} {value:.3g}" for knob, value in found.tuning.items())
    kept = "meets" if found.meets else "does not meet"
    print(f"{scheme}: {numbers or 'nothing is set'}; {kept} the rule; RMS e {found.error:.4g};")
    print(f"    delay borne {margins.delay:.3g} s, gain up {margins.gain_up:.3g}, down {margins.gain_down:.3g}", flush=True)
    if found.at_edge:
        print(f"    at the end of its range: {', '.join(found.at_edge)}", flush=True)


if __name__ == "__main__":
    name, *chosen = sys.argv[1:] or ["f16-pitch"]
    nominal = axis_of(name, FlightCondition())
    for one in chosen or SCHEMES:
        show(one, tuned(nominal, one))
