"""Vehicles, each in a folder, flown by sampled controllers: their simulators are other packages, and each flight has its own
process."""
