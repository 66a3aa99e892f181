"""
Is it adapting?
===============

The plot shows how far the estimates move, for commands that excite the plant and for one that becomes constant. A run reports
this under ``adapting``.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from barbalat import Mrac, Simulation, load_case, simulate
from barbalat.signals import Sine, Sines, Step

problem = load_case("paper").problem
commands = {
    "one sine": Sine(amplitude=5, frequency=0.5),
    "three sines": Sines(amplitudes=[5, 5, 5], frequencies=[0.5, 1.3, 2.9]),
    "a step": Step(amplitude=5),
}
fig, ax = plt.subplots(figsize=(8, 4), layout="constrained")
for name, command in commands.items():
    run = simulate(replace(problem, reference=command), [Mrac(gamma=1)], Simulation(t_end=60, dt=1e-3))["MRAC"]
    moved = np.cumsum(run.envelope.theta_hat_path.sum(axis=1))
    ax.plot(run.t[1:], moved, label=f"{name}: excitation in the tail {run.adapting.excitation.tail:.1e}")
ax.set(xlabel="t [s]", ylabel="path of the estimates")
ax.legend()
