"""Simulated controllers as source for a flight computer: a slice of the operations that were simulated, printed."""
