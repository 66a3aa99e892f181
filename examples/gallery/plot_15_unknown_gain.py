"""
Unknown input effectiveness
===========================

The elevator of an F-16 has 70 % of its effectiveness, an actuator, and limits on deflection and rate. The gain is the
last estimate.
"""

from barbalat import Simulation, load_case, simulate
from barbalat.results import plot

case = load_case("f16-short-period")
plot(simulate(case.problem, case.controllers[:1], Simulation(t_end=60, dt=1e-3)))
