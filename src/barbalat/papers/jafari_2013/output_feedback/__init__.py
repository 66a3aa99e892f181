"""Output feedback: what its L1 controllers are, and the robust MRAC for any relative degree."""
