"""
Commands and disturbances
=========================

All kinds of signals can be a command or a disturbance. Signals that jump declare when, and the solver divides its steps there.
"""

import matplotlib.pyplot as plt
import numpy as np

from barbalat.signals import Chirp, Constant, Recorded, Sine, Sines, Square, Step, Steps

signals = {
    "Constant": Constant(amplitude=0.5),
    "Step": Step(amplitude=1, start=3),
    "Steps": Steps(times=[2, 5, 8], values=[1, -1, 0.5]),
    "Sine": Sine(amplitude=1, frequency=2),
    "Sines": Sines(amplitudes=[0.6, 0.4], frequencies=[1, 5]),
    "Square": Square(amplitude=1, frequency=1.5),
    "Chirp": Chirp(amplitude=1, frequency_start=0.5, frequency_end=8, duration=10),
    "Recorded": Recorded(times=[0, 2, 4, 10], values=[0, 1, -1, 0.5]),
}
t = np.linspace(0, 10, 1001)
fig, axes = plt.subplots(2, 4, figsize=(10, 4), layout="constrained", sharex=True, sharey=True)
for ax, (name, signal) in zip(axes.flat, signals.items(), strict=True):
    ax.plot(t, [signal(one) for one in t])
    ax.set_title(name)
for ax in axes[1]:
    ax.set_xlabel("t [s]")
