"""
An F-16 becomes unstable
========================

JSBSim's F-16 tracks a pitch-rate command. At 10 s a tenth of its weight moves aft, and the airframe is unstable from then on.
Feedback alone loses control; an integrator or an estimate keeps it. Requires ``barbalat[flight]``.
"""

from barbalat.flights import fly

found = fly("f16-pitch", schemes=["lqr", "linear", "robust-mrac", "l1-piecewise-flown"], failures=["aft-cg"])
print(found)
found.plot()
