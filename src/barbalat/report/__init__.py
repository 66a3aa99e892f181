"""Figures, tables and pages of results; only the command line imports this package."""
