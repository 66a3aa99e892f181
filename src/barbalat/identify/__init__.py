"""A plant from data: an output-error fit, and the set of all plants that explain the data within a stated noise bound."""
