"""Certificates, computed before any run: conditions, bounds, norms, limits of the numerics, margins, and Table 1."""
