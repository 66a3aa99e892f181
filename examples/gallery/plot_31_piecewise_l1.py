"""
The L1 law used in flight
=========================

The piecewise-constant law estimates the disturbance of a quadrotor's pitch at 400 Hz. From 4 s on a mass hangs off
centre. The estimate is the difference of two measurements. The law is a linear controller, so its margins are exact.
"""

import matplotlib.pyplot as plt

from barbalat import L1PiecewiseConstant, certify, load_case, simulate

case = load_case("quadrotor-pitch")
laws = [law for law in case.controllers if isinstance(law, L1PiecewiseConstant)]
runs = simulate(case.problem, laws, case.simulation)
certificates = certify(case.problem, laws, case.simulation)
fig, (angle, sigma) = plt.subplots(2, 1, figsize=(8, 5), sharex=True, layout="constrained")
for name, run in runs.items():
    margin = 1e3 * certificates[name].values["delay_margin"]
    angle.plot(run.t, run.x[:, 0], label=f"{name}, tolerates {margin:.0f} ms more")
    sigma.plot(run.t, run.reported["sigma_hat"][:, 0], label=name)
angle.plot(run.t, run.x_m[:, 0], "k--", lw=1, label="model")
angle.set(ylabel="pitch [rad]")
sigma.set(xlabel="t [s]", ylabel=r"$\hat\sigma_m$ [N m]")
angle.legend()
