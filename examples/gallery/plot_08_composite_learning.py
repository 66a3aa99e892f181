"""
Composite learning
==================

The command excites the plant for five seconds only. The law with a memory of past data keeps learning after that; the law
without one stops.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from barbalat import Mrac, Simulation, load_case, simulate
from barbalat.laws import CompositeLearning
from barbalat.signals import Steps

problem = replace(load_case("paper").problem, reference=Steps(times=[1, 3, 5], values=[5, -5, 0]))
memory = CompositeLearning(gamma_c=5, time_constant=0.2)
controllers = [Mrac(gamma=2, name="without memory"), Mrac(gamma=2, learning=memory, name="with memory")]
fig, ax = plt.subplots(figsize=(8, 4), layout="constrained")
for name, run in simulate(problem, controllers, Simulation(t_end=40, dt=1e-3)).items():
    ax.semilogy(run.t, np.linalg.norm(run.theta_hat - problem.plant.theta, axis=1), label=name)
ax.axvspan(1, 5, color="0.9", label="the command moves")
ax.set(xlabel="t [s]", ylabel=r"$|\hat\theta - \theta|$")
ax.legend()
