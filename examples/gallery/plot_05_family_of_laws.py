"""
The family of adaptive laws
===========================

Six laws on the same parametric model. The plot shows how fast the distance to the true parameters falls.
"""

import matplotlib.pyplot as plt
import numpy as np

from barbalat import NormalizedMrac, Simulation, load_case, simulate
from barbalat.laws import Gradient, IntegralCost, LeastSquares, LeastSquaresBounded, LeastSquaresForgetting, LeastSquaresResetting

problem = load_case("paper").problem
laws = {
    "gradient": Gradient(gamma=100),
    "integral cost": IntegralCost(gamma=100, forgetting=0.1),
    "least squares": LeastSquares(covariance0=100),
    "forgetting": LeastSquaresForgetting(covariance0=100, forgetting=0.1),
    "resetting": LeastSquaresResetting(rho_0=100, rho_1=1),
    "bounded covariance": LeastSquaresBounded(covariance0=100, forgetting=0.1, covariance_bound=1000),
}
runs = simulate(
    problem, [NormalizedMrac(law=law, c_0=[1, 1], name=name) for name, law in laws.items()], Simulation(t_end=60, dt=1e-3)
)
fig, ax = plt.subplots(figsize=(8, 4), layout="constrained")
for name, run in runs.items():
    ax.semilogy(run.t, np.linalg.norm(run.theta_hat - problem.plant.theta, axis=1), label=name)
ax.set(xlabel="t [s]", ylabel=r"$|\hat\theta - \theta|$")
ax.legend(ncols=2)
