"""
A guaranteed bound and the simulated errors
==============================================

The error bound of Theorem 1 is known before any simulation. No run exceeds it or comes near it.
"""

import matplotlib.pyplot as plt
import numpy as np

from barbalat import Mrac, Simulation, certify, load_case, simulate_ensemble

problem, simulation = load_case("paper").problem, Simulation(t_end=60, dt=2e-4)
gains = np.geomspace(0.01, 100, 13)
controllers = [Mrac(gamma=float(gain)) for gain in gains]
bounds = [certify(problem, [one], simulation)["MRAC"].values["error_bound"] for one in controllers]
largest = simulate_ensemble([(problem, one) for one in controllers], simulation).metrics.max_abs_e.max(axis=1)
fig, ax = plt.subplots(figsize=(8, 4), layout="constrained")
ax.loglog(gains, bounds, label="guaranteed bound (9)")
ax.loglog(gains, largest, "o", label="largest |e| in a run of 60 s")
ax.set(xlabel=r"$\Gamma$", ylabel="|e|")
ax.legend()
