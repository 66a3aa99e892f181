"""Functional Mock-up Units, FMI 2.0 and 3.0 for Co-Simulation: the controller, its plant, or both as one loop."""
