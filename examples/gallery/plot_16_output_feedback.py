"""
Output feedback at relative degree two
======================================

The states are not measured. The designer knows the order, the relative degree and the sign of the gain; least squares
learn the rest.
"""

from barbalat import MracOutput, OutputPlant, OutputProblem, OutputReferenceModel, Simulation, TransferFunction, simulate
from barbalat.laws import LeastSquares
from barbalat.results import plot
from barbalat.signals import Square

problem = OutputProblem(
    plant=OutputPlant(transfer_function=TransferFunction([1.0, 3.0], [1.0, 3.0, -1.0, 2.0])),
    reference_model=OutputReferenceModel(transfer_function=TransferFunction([4.0], [1.0, 4.0, 4.0])),
    reference=Square(amplitude=1, frequency=0.3),
)
law = LeastSquares(covariance0=1000)
names = {"without auxiliary input": None, "tau = 0.1 s": 0.1}
controllers = [
    MracOutput(order=3, relative_degree=2, sign=1, law=law, c_0_min=0.1, tau=tau, name=name) for name, tau in names.items()
]
plot(simulate(problem, controllers, Simulation(t_end=60, dt=1e-3)))
