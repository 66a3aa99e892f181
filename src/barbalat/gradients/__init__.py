"""Derivatives of a run's metrics with respect to the numbers in its case, checked by finite differences."""
