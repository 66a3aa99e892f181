"""A problem and any controller as one system of differential equations; the only place that packs a state vector."""
