"""
Solver or loop: the cause of an oscillation
===========================================

A run that left its solver's region of stability is repeated at a finer step, and the report says whether the solver
or the loop caused the oscillation.
"""

from barbalat import Mrac, Simulation, load_case, simulate
from barbalat.results import plot
from barbalat.studies import check_numerics

problem = load_case("paper").problem
results = check_numerics(simulate(problem, [Mrac(gamma=1e5)], Simulation(t_end=10, dt=1e-3)))
print(results["MRAC"].check.sentence)
finer = simulate(problem, [Mrac(gamma=1e5, name="MRAC at a tenth of the step")], Simulation(t_end=10, dt=1e-4))
plot([*results.values(), *finer.values()])
