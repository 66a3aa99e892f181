"""A plant from data: least squares, and the set of all plants that explain the data within a stated noise bound."""
