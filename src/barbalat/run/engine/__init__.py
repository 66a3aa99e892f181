"""Running kernels: one controller with its record, many members at once, and the same run at a finer step."""
