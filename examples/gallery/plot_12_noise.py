"""
Measurement noise
=================

The plot shows the effect of the same noise, with the same seed, on the control of two schemes.
"""

from dataclasses import replace

from barbalat import L1Adaptive, Mrac, Simulation, input_filter, load_case, simulate
from barbalat.plants import Noise, Sensor
from barbalat.results import plot

problem = replace(load_case("paper").problem, sensor=Sensor(noise=Noise(std=0.5, sample_time=0.01, seed=3)))
controllers = [Mrac(gamma=1), L1Adaptive(gamma=100, filter=input_filter(kappa=0.02))]
plot(simulate(problem, controllers, Simulation(t_end=20, dt=1e-3)))
