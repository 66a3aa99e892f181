"""Plots as data, and their drawing: panels over time and responses over frequency. Runs and certificates do not occur here."""
