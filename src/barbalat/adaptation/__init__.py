"""Adaptive laws, their modifications and normalisation, which the schemes share; the registry is in ``laws``."""
