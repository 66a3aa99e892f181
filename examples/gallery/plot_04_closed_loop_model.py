"""
MRAC with a closed-loop reference model
=======================================

The feedback L pulls the model towards the plant. The estimates swing less in the transient, but the error relative to the
original model is larger.
"""

from dataclasses import replace

import matplotlib.pyplot as plt

from barbalat import Mrac, MracClosedLoop, Simulation, load_case, simulate
from barbalat.signals import Step

problem = replace(load_case("paper").problem, reference=Step(amplitude=5, start=1))
controllers = [Mrac(gamma=100)]
controllers += [MracClosedLoop(gamma=100, model_feedback=[[-g, 0], [0, -g]], name=f"L = -{g} I") for g in (2, 10)]
fig, axes = plt.subplots(2, 1, figsize=(8, 5), layout="constrained", sharex=True)
for name, run in simulate(problem, controllers, Simulation(t_end=15, dt=1e-3)).items():
    axes[0].plot(run.t, run.e[:, 0], label=name)
    axes[1].plot(run.t, run.theta_hat[:, 0])
axes[0].set(ylabel="$e_1$")
axes[0].legend()
axes[1].set(xlabel="t [s]", ylabel=r"$\hat\theta_1$")
