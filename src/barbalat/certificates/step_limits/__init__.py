"""The largest gain and step that a solver tolerates: estimates from frozen laws, made before any simulation."""
