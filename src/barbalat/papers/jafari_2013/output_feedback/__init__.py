"""Output feedback: the nature of its L1 controllers, and the robust MRAC for any relative degree."""
