"""LTI systems and their analysis, without adaptive control."""
