"""Adaptive schemes compared with linear robust designs."""
