"""Derivatives of a run's figures in the numbers of its case, and their check by differences."""
