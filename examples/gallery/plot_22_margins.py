"""
Margins of a loop with a delay
==============================

The Nyquist curve of a loop with 50 ms of delay. The margins are exact: the delay is not approximated, and no crossover
is missed between two points of a grid.
"""

import matplotlib.pyplot as plt
import numpy as np

from barbalat import TransferFunction
from barbalat.systems import margins

delay = 0.05
loop = TransferFunction([2.0], [1.0, 1.0, 0.0])
found = margins(loop, delay=delay)
w = np.geomspace(0.3, 60, 2000)
s = 1j * w
L = np.polyval(loop.num, s) / np.polyval(loop.den, s) * np.exp(-s * delay)
fig, ax = plt.subplots(figsize=(6, 5), layout="constrained")
ax.plot(L.real, L.imag)
ax.add_patch(plt.Circle((0, 0), 1, fill=False, color="0.6"))
ax.plot(-1, 0, "k+", markersize=12)
ax.plot(-1 / found.gain_up, 0, "o", label=f"factor {found.gain_up:.2f}")
ax.plot(
    -np.cos(found.phase), -np.sin(found.phase), "s", label=f"{np.degrees(found.phase):.1f}°, or {found.delay * 1e3:.0f} ms more"
)
ax.set(xlabel="Re L", ylabel="Im L", xlim=(-2, 1), ylim=(-2, 1), aspect="equal")
ax.legend()
