"""Schemes and the fixed baseline compete under a specification."""
