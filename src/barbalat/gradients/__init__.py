"""Derivatives of a run's metrics with respect to the numbers of its case, checked by differences."""
