"""The abstract of arXiv:math/0608320: guarantees for the transient of L1-AC, and their absence for MRAC."""
