"""Contests: every scheme is tuned under one rule and then measured on validation plants, commands and noise."""
