"""
A sweep
=======

Plants of the known set are simulated at every gain of a grid; each draw is used at each point. Failures are counted first, with
an exact interval. ``barbalat sweep`` does the same for a case file, stores the results, and runs any member again.
"""

import matplotlib.pyplot as plt

from barbalat.studies import sweep

found = sweep(
    "first-order",
    vary={"controller[0].gamma": "1:1000:7:log"},
    sample={"plant.theta[0]": "uniform:-2:2"},
    members=200,
)
table = found.to_pandas()
fig, ax = plt.subplots(figsize=(8, 4), layout="constrained")
name = found.controllers[0]
for gamma, members in table.groupby("controller[0].gamma"):
    ax.plot(members["plant.theta[0]"], members[f"{name}/max_abs_e[0]"], ".", markersize=3, label=f"gain {gamma:.3g}")
ax.set(xlabel="the plant's parameter", ylabel="largest |e|", title=name)
ax.legend(ncols=2)
