"""
A nonlinear plant: wing rock
============================

The roll of a slender delta wing. The uncertainty is nonlinear in the state and linear in its parameters; any known
phi(x) can be given.
"""

from barbalat import Simulation, load_case, simulate
from barbalat.results import plot

case = load_case("wing-rock")
print(case.problem.plant.regressor.terms)
plot(simulate(case.problem, case.controllers[:2], Simulation(t_end=50, dt=1e-3)))
