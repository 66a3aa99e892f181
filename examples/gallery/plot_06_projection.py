"""
Projection onto a box and onto a ball
=====================================

The path of the estimates in the plane of the parameters. Both sets contain the true parameters, and the estimates never leave
them.
"""

from dataclasses import replace

import matplotlib.pyplot as plt

from barbalat import Mrac, ParameterBox, Simulation, load_case, simulate
from barbalat.plants import ParameterBall

paper = load_case("paper").problem
sets = {"box": ParameterBox(lower=[-5, -5], upper=[5, 5]), "ball": ParameterBall(center=[0, 0], radius=5.5)}
fig, ax = plt.subplots(figsize=(5.5, 5), layout="constrained")
for name, known in sets.items():
    run = simulate(replace(paper, uncertainty=known), [Mrac(gamma=0.02)], Simulation(t_end=30, dt=1e-3))["MRAC"]
    ax.plot(*run.theta_hat.T, label=name)
ax.add_patch(plt.Rectangle((-5, -5), 10, 10, fill=False, color="0.6"))
ax.add_patch(plt.Circle((0, 0), 5.5, fill=False, color="0.6"))
ax.plot(*paper.plant.theta, "k*", label="true")
ax.set(xlabel=r"$\hat\theta_1$", ylabel=r"$\hat\theta_2$", aspect="equal", xlim=(-6, 6), ylim=(-6, 6))
ax.legend()
