"""Modelling errors: Lemma 1, Theorem 2, the error at a fixed tau, and unmodelled dynamics."""
