"""Comparison: tuning by search, schemes tuned under one rule, and the trade-off between tracking and robustness."""
