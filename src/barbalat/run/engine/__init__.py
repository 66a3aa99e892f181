"""Runs kernels: one controller with its record, many members at once, and the same run with a finer step."""
