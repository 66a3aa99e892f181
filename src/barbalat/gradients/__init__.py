"""Derivatives of a run's metrics in the numbers of its case, and their check by differences."""
