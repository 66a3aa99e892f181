"""The largest gain and step for a solver, estimated from frozen laws before any simulation."""
