"""The abstract of arXiv:math/0608320: what L1-AC guarantees of the transient, and what the MRAC is said not to."""
