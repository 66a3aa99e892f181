"""
Radial basis functions
======================

An uncertainty without a known formula, represented by nine Gaussian functions of the state.
"""

import numpy as np

from barbalat import Mrac, Plant, Problem, ReferenceModel, Simulation, simulate
from barbalat.regressors import GaussianRBF
from barbalat.results import plot
from barbalat.signals import Sine

centers = [[a, b] for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)]
problem = Problem(
    plant=Plant(
        A_m=[[0, 1], [-1, -1.4]],
        b=[0, 1],
        theta=np.random.default_rng(0).normal(size=9),
        regressor=GaussianRBF(centers=centers, width=0.8),
    ),
    reference_model=ReferenceModel(k_0=1),
    reference=Sine(amplitude=1, frequency=0.7),
)
plot(simulate(problem, [Mrac(gamma=50)], Simulation(t_end=60, dt=1e-3)))
