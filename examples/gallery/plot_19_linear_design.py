"""
A linear robust design and the adaptive ones
============================================

A PI controller and an H-infinity design on the same plant, with a delay of 10 ms that the designs do not consider.
"""

from dataclasses import replace

import matplotlib.pyplot as plt

from barbalat import L1Adaptive, RobustMrac, Simulation, input_filter, load_case, simulate
from barbalat.designs import hinf_feedback, pi_feedback
from barbalat.laws import LeastSquares
from barbalat.plants import PlantInput

paper = load_case("paper").problem
problem = replace(paper, plant=replace(paper.plant, input=PlantInput(delay=0.01)))
controllers = [
    L1Adaptive(gamma=100, filter=input_filter(kappa=0.02)),
    RobustMrac(c_0=[1, 1], tau=0.02, law=LeastSquares(covariance0=500)),
    pi_feedback(paper.known, unmodelled_delay=0.02),
    hinf_feedback(paper.known, unmodelled_delay=0.02),
]
fig, ax = plt.subplots(figsize=(8, 4), layout="constrained")
for name, run in simulate(problem, controllers, Simulation(t_end=60, dt=1e-3)).items():
    ax.semilogy(run.t, abs(run.e).max(axis=1) + 1e-6, label=name)
ax.set(xlabel="t [s]", ylabel="largest |e_i|", ylim=(1e-2, 1e3))
ax.legend()
