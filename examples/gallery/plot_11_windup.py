"""
An input with limits
====================

When the actuator saturates, a law that ignores the saturation learns from an error that no estimate can remove. With the
modified error it does not.
"""

from dataclasses import replace

from barbalat import Mrac, Plant, Problem, ReferenceModel, Simulation, simulate
from barbalat.laws import ModifiedError
from barbalat.plants import PlantInput
from barbalat.results import plot
from barbalat.signals import Square

problem = Problem(
    plant=Plant(A_m=[[0, 1], [-1, -1.4]], b=[0, 1], theta=[-2, -1], input=PlantInput(saturation=[-2, 2])),
    reference_model=ReferenceModel(k_0=1),
    reference=Square(amplitude=1, frequency=0.4),
)
plain = Mrac(gamma=20)
remedy = replace(plain, modified_error=ModifiedError(), name="modified error")
plot(simulate(problem, [plain, remedy], Simulation(t_end=60, dt=1e-3)))
