"""
Monte Carlo
===========

A thousand plants of the known set, simulated on all cores without a trajectory in memory. The metrics are computed
over every solver step.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from barbalat import L1Adaptive, Mrac, Simulation, input_filter, load_case, simulate_ensemble

problem = load_case("paper").problem
thetas = np.random.default_rng(1).uniform(-5, 5, (1000, 2))
plants = [replace(problem, plant=replace(problem.plant, theta=theta)) for theta in thetas]
fig, ax = plt.subplots(figsize=(8, 4), layout="constrained")
for controller in (Mrac(gamma=10), L1Adaptive(gamma=100, filter=input_filter(kappa=0.02))):
    found = simulate_ensemble([(plant, controller) for plant in plants], Simulation(t_end=60, dt=1e-3)).metrics
    worst = np.sort(found.tail_max_abs_e.max(axis=1))
    ax.semilogx(worst, np.linspace(0, 100, len(worst)), label=controller.name)
ax.set(xlabel="largest |e| in the last quarter", ylabel="% of the plants")
ax.legend()
