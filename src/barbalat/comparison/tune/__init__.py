"""Tuning: the search for settings of a controller under constraints."""
