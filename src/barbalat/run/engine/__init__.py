"""Runs kernels: recorded single runs, many members at once, and repetitions with a finer step."""
