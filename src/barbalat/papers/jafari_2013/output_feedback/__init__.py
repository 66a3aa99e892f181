"""Output feedback: the structure of its L1 controllers, and the robust MRAC for any relative degree."""
