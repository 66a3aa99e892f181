"""Figures, tables and pages made of results; nothing imports this package but the command line."""
