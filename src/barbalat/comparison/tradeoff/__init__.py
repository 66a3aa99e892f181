"""Tracking against robustness over all tunings of several schemes."""
