"""The linear loops that the schemes become, with known parameters, fast adaptation or frozen estimates, and their margins."""
