"""The numbers of a case that can be varied: their paths, their effects on a run, and the kernel arguments for varied numbers."""
