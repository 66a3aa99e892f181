"""The three schemes of the paper on its own example, in a few lines."""

from barbalat import (
    L1Adaptive,
    Mrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    RobustMrac,
    Simulation,
    input_filter,
    simulate,
)
from barbalat.laws import LeastSquares
from barbalat.signals import Sine

problem = Problem(
    plant=Plant(A_m=[[0, 1], [-0.3, -1]], b=[0, 1], theta=[4, -3], x0=[1, 1]),
    reference_model=ReferenceModel(k_0=4),
    reference=Sine(amplitude=50, frequency=0.5),
    uncertainty=ParameterBox(lower=[-5, -5], upper=[5, 5]),
)
controllers = [
    Mrac(gamma=10),
    L1Adaptive(gamma=1e4, filter=input_filter(kappa=0.02)),
    RobustMrac(c_0=[1, 1], tau=0.5, law=LeastSquares(covariance0=500)),
]
for result in simulate(problem, controllers, Simulation(t_end=60, dt=1e-4)).values():
    print(
        f"{result.name}: max |e| {result.figures['max_abs_e']}, in the tail {result.figures['tail_max_abs_e']}; {result.numerics}"
    )
