"""
The delay that a loop tolerates
=====================================

The delay at which each loop begins to oscillate, and the delay at which its motion is lost, found by simulation.
"""

import matplotlib.pyplot as plt

from barbalat import L1Adaptive, Mrac, RobustMrac, Simulation, input_filter, load_case
from barbalat.laws import LeastSquares
from barbalat.studies import delay_margins

problem = load_case("third-order").problem
controllers = [
    Mrac(gamma=50),
    L1Adaptive(gamma=1e3, filter=input_filter(kappa=0.05)),
    RobustMrac(tau=0.2, law=LeastSquares(covariance0=100)),
]
found = delay_margins(problem, controllers, Simulation(t_end=40, dt=2e-3))
fig, ax = plt.subplots(figsize=(8, 3), layout="constrained")
for i, (name, margin) in enumerate(found.items()):
    ax.barh(name, margin.loss.tolerates * 1e3, height=0.6, color="0.8", label=None if i else "keeps its motion")
    ax.barh(name, margin.onset.tolerates * 1e3, height=0.3, color="C0", label=None if i else "without oscillation")
ax.set(xlabel="delay at the plant's input [ms]")
ax.legend()
