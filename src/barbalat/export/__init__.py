"""Simulated controllers as source code for a flight computer, printed from a slice of the simulated operations."""
