"""
Rohrs' counterexample
=====================

A first-order controller runs on a plant with unmodelled dynamics. The classical law drifts and bursts; with a leakage it
stays bounded.
"""

from barbalat import load_case, simulate
from barbalat.results import plot

case = load_case("rohrs")
chosen = [controller for controller in case.controllers if controller.name in ("Classical", "Sigma-modification")]
plot(simulate(case.problem, chosen, case.simulation))
