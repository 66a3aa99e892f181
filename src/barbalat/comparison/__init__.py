"""Comparison: settings found by search, schemes tuned under one rule, and what tracking costs in robustness."""
