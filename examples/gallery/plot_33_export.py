"""
Export to C99
=============

A sampled controller is exported as C for a flight computer. Its self-test replays the samples of the simulation, drawn here, and
requires the same control bit for bit. ``barbalat export`` does the same for a case file.
"""

import tempfile

import matplotlib.pyplot as plt

from barbalat import Sampled, Simulation, load_case, simulate
from barbalat.exports import export_controller

case = load_case("first-order")
controller = next(one for one in case.controllers if isinstance(one, Sampled))
folder = export_controller(case.problem, controller, case.simulation, out=tempfile.mkdtemp())
lines = len((folder / "controller.c").read_text().splitlines())
run = simulate(case.problem, controller, Simulation(t_end=3, dt=1e-3))[controller.name]
fig, ax = plt.subplots(figsize=(8, 3), layout="constrained")
ax.step(run.t, run.u, where="post")
ax.set(title=f"{controller.name}: {lines} lines of C compute these samples", xlabel="t [s]", ylabel="u")
