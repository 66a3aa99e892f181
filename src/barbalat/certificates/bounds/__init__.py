"""Guaranteed bounds on the model, on the error by Theorem 1, and on laws, regressors and output-feedback loops."""
