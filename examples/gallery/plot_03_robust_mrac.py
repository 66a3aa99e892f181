"""
Robust MRAC and its auxiliary input
===================================

The remaining error shrinks in proportion to the time constant tau of the auxiliary input.
"""

from barbalat import RobustMrac, Simulation, load_case, simulate
from barbalat.laws import LeastSquares
from barbalat.results import plot

problem = load_case("paper").problem
law = LeastSquares(covariance0=500)
controllers = [RobustMrac(c_0=[1, 1], tau=tau, law=law, name=f"tau = {tau} s") for tau in (0.5, 0.1, 0.02)]
plot(simulate(problem, controllers, Simulation(t_end=60, dt=1e-3)))
