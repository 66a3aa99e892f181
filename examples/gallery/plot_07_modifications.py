"""
Drift, and the modifications that stop it
=========================================

There is a constant disturbance and no command. The estimate of the unmodified law grows without bound, since this keeps reducing
the error. Each modification stops this, at a price.
"""

import matplotlib.pyplot as plt

from barbalat import Mrac, Plant, Problem, ReferenceModel, Simulation, simulate
from barbalat.laws import DeadZone, EpsilonModification, FixedSigma, SwitchingSigma
from barbalat.signals import Constant

problem = Problem(
    plant=Plant(A_m=[[-1]], b=[1], theta=[2], x0=[1]),
    reference_model=ReferenceModel(k_0=1),
    disturbance=Constant(amplitude=1),
)
modifications = {"none": {}, "fixed sigma": {"leakage": FixedSigma(sigma=0.05)}, "dead zone": {"dead_zone": DeadZone(g_0=0.2)}}
modifications |= {
    "switching sigma": {"leakage": SwitchingSigma(sigma=1, M_0=3)},
    "epsilon": {"leakage": EpsilonModification(nu=0.05)},
}
controllers = [Mrac(gamma=5, name=name, **given) for name, given in modifications.items()]
fig, axes = plt.subplots(2, 1, figsize=(8, 5), layout="constrained", sharex=True)
for name, run in simulate(problem, controllers, Simulation(t_end=200, dt=2e-3)).items():
    axes[0].plot(run.t, run.theta_hat[:, 0], label=name)
    axes[1].semilogy(run.t, abs(run.e[:, 0]) + 1e-6)
axes[0].set(ylabel=r"$\hat\theta$")
axes[0].legend(ncols=2)
axes[1].set(xlabel="t [s]", ylabel="|e|", ylim=(0.03, 3))
