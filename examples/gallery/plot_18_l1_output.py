"""
L1 output feedback is a linear controller
=========================================

Inside its projection bounds it can be replaced by a transfer function. The two runs differ only by rounding.
"""

import matplotlib.pyplot as plt
import numpy as np

from barbalat import load_case, simulate

case = load_case("l1-output")
results = simulate(case.problem, case.controllers, case.simulation)
first, twin, *_ = results.values()
fig, axes = plt.subplots(2, 1, figsize=(8, 5), layout="constrained", sharex=True)
axes[0].plot(first.t, first.y, label=first.name)
axes[0].plot(twin.t, twin.y, "--", label=twin.name)
axes[0].set(ylabel="y")
axes[0].legend()
axes[1].semilogy(first.t, np.abs(first.y - twin.y) + 1e-18)
axes[1].set(xlabel="t [s]", ylabel="|difference|")
