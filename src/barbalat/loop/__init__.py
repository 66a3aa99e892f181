"""A problem and any controller as one system of differential equations; the only room that packs state vectors."""
