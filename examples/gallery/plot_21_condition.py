"""
The condition of L1 adaptive control
====================================

The L1 norm behind the condition, over the filter's time constant, for three sizes of the known set. Each point is an
enclosure in ball arithmetic.
"""

import matplotlib.pyplot as plt
import numpy as np

from barbalat import load_case
from barbalat.systems import l1_norm

plant = load_case("paper").problem.plant
kappas = np.geomspace(0.002, 0.2, 12)
norms = []
for kappa in kappas:  # W_b(s) kappa s/(kappa s + 1), with the filter's state below the plant's
    A = np.block([[plant.A_m, -plant.b[:, None] / kappa], [np.zeros((1, 2)), -1 / kappa]])
    B = np.append(plant.b, 1.0)[:, None]
    norms.append(l1_norm(A, B, np.eye(2, 3), np.zeros((2, 1))).upper)
fig, ax = plt.subplots(figsize=(8, 4), layout="constrained")
for half in (2, 5, 10):
    ax.loglog(kappas, 2 * half * np.array(norms), "o-", label=rf"$\Omega = \pm {half}$")
ax.axhline(1, color="k", linestyle=":", label="the theorem applies below")
ax.set(xlabel=r"$\kappa$ [s]", ylabel=r"$\|W_b (1 - C)\|_1\, \theta_{max}$")
ax.legend()
