"""A problem and any controller as one system of differential equations; the only package that packs state vectors."""
