"""Schemes that measure y only."""
