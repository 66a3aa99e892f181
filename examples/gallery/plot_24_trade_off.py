"""
All tunings at once
===================

Tracking error against the tolerated delay, for the tunings of three schemes on one plant. A scheme's front consists
of the tunings that no other tuning beats.
"""

from barbalat import Simulation, load_case
from barbalat.studies import trade_off

case = load_case("third-order")
found = trade_off(case.problem, Simulation(t_end=30, dt=2e-3), density=3, plants=1)
found.plot()
