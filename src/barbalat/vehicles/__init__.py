"""Vehicles, each a folder, that sampled controllers fly: simulated by others, each flight in a process of its own."""
