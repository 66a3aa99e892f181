"""Certificates, computed before any run: conditions, bounds, norms, numerical limits, margins, and Table 1."""
