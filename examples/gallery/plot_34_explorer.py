"""
Settings of a page
==================

``explore`` makes one offline page with a slider for each parameter, and ``at`` gives the case of any setting of the page. The
plot shows the onset of L1's oscillation at two steps, as in a lesson of ``barbalat explore paper``.
"""

from dataclasses import replace

from barbalat import Simulation, load_case, simulate
from barbalat.results import plot
from barbalat.studies import explore

case = load_case("paper")
page = explore(case.problem, case.controllers, Simulation(t_end=20, dt=1e-4))
results = []
for dt in (1e-4, 5e-5):
    moved = page.at({"controller[1].gamma": 3000.0, "simulation.dt": dt})
    l1 = replace(moved.controllers[1], name=f"L1, h = {dt:g} s")
    results += simulate(moved.problem, l1, moved.simulation).values()
plot(results)
