"""
L1 adaptive control, at two steps
=================================

The same controller, with a gain of 10000, at the step of the paper's Figure 3 and at that of Figure 4. The solver
causes the oscillation of the estimates, and the run says so. The shading extends from the smallest to the largest
value over all steps between two recorded instants.
"""

import matplotlib.pyplot as plt

from barbalat import L1Adaptive, Simulation, input_filter, load_case, simulate

problem = load_case("paper").problem
l1 = L1Adaptive(gamma=1e4, filter=input_filter(kappa=0.02))
fig, axes = plt.subplots(2, 1, figsize=(8, 5), layout="constrained", sharex=True)
for ax, dt in zip(axes, (1e-4, 1e-5), strict=True):
    run = simulate(problem, [l1], Simulation(t_end=30, dt=dt))["L1"]
    for i in range(2):
        low, high = run.envelope.theta_hat_min[:, i], run.envelope.theta_hat_max[:, i]
        ax.fill_between(run.t[1:], low, high, step="pre", color=f"C{i}", alpha=0.35, label=rf"$\hat\theta_{i + 1}$")
    ax.set(title=f"h = {dt:g} s: {run.label or 'inside the region of stability'}", ylabel="estimates")
axes[0].legend()
axes[1].set_xlabel("t [s]")
