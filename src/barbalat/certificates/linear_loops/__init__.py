"""The linear loops to which the schemes reduce, with known parameters, fast adaptation or frozen estimates, and their margins."""
