"""Modifications of a law, one per file: leakage and dead zones."""
