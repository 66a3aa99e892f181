"""Tracking: Theorem 1's bounds, any command, L1's own objective, and all objectives together."""
