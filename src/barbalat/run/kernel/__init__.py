"""Makes the kernel of a loop: its step as operations, its numbers, its time grid, and its accumulators."""
