"""Adaptive laws, their modifications and normalisation, shared by the schemes; the registry is in ``laws``."""
