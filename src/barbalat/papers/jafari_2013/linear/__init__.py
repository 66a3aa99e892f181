"""Adaptive schemes beside linear robust designs."""
