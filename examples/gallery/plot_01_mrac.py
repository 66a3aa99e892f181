"""
Standard MRAC
=============

The plant learns to behave like its model. The error goes to zero, and the estimates converge in the directions that the command
excites.
"""

from barbalat import Mrac, ParameterBox, Plant, Problem, ReferenceModel, Simulation, simulate
from barbalat.signals import Sine

problem = Problem(
    plant=Plant(A_m=[[0, 1], [-0.3, -1]], b=[0, 1], theta=[4, -3], x0=[1, 1]),
    reference_model=ReferenceModel(k_0=4),
    reference=Sine(amplitude=50, frequency=0.5),
    uncertainty=ParameterBox(lower=[-5, -5], upper=[5, 5]),
)
result = simulate(problem, [Mrac(gamma=1)], Simulation(t_end=60, dt=1e-3))["MRAC"]
result.plot()
