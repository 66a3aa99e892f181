"""Guaranteed bounds: of the model, of the error by Theorem 1, of laws, regressors and output-feedback loops."""
