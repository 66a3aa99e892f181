"""
A sampled law that is numerically stable at any gain
====================================================

The plot shows how much the estimates move per second, over the gain, at a sample time of 1 ms. Explicit Euler steps chatter; the
midpoint form does not.
"""

import matplotlib.pyplot as plt
import numpy as np

from barbalat import Mrac, Sampled, Simulation, load_case, simulate

problem, simulation = load_case("paper").problem, Simulation(t_end=20, dt=1e-3)
gains = np.geomspace(0.1, 1e6, 8)
fig, ax = plt.subplots(figsize=(8, 4), layout="constrained")
for form in ("euler", "midpoint"):
    moves = []
    for gain in gains:
        law = Sampled(controller=Mrac(gamma=float(gain)), sample_time=1e-3, discretization=form)
        moves.append(max(simulate(problem, [law], simulation)["MRAC"].figures["theta_hat_variation_rate"]))
    ax.loglog(gains, moves, "o-", label=form)
ax.set(xlabel=r"$\Gamma$", ylabel="|change| of an estimate per second")
ax.legend()
