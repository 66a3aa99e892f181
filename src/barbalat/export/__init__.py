"""Simulated controllers as source for a flight computer: a slice of the operations that were simulated, printed."""

TARGETS = ("c99", "fmu2", "fmu3")
"""What can be exported to."""
