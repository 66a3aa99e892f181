"""The numbers of a case: their paths, their effects on a run, and the arguments of kernels that vary them."""
