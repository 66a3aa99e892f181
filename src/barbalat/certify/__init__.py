"""Conditions, bounds, norms, limits of the numerics and margins: computed before anything is simulated."""
