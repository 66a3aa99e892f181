"""Vehicles that sampled controllers fly, each in a folder. Their simulators are other packages, and each flight has its own
process."""
