"""The numbers of a case: where each stands, what it does to a run, and what kernels are handed where it varies."""
