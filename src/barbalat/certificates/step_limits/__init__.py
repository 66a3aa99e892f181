"""The largest gain and step that a solver bears: estimates from frozen laws, made before any simulation."""
