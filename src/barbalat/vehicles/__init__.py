"""Vehicles that sampled controllers fly, each in a folder. Their simulators are external packages, and each controller flies in a
separate process."""
