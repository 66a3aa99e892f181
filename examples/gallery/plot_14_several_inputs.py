"""
Several inputs
==============

The lateral motion of an aircraft: aileron and rudder, two commands, four states.
"""

from barbalat import Simulation, load_case, simulate
from barbalat.results import plot

case = load_case("lateral-aircraft")
plot(simulate(case.problem, case.controllers[:1], Simulation(t_end=40, dt=1e-3)))
