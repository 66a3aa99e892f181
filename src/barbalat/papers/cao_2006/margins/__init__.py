"""The exact margins of the linear loops of MRAC and L1-AC under an unknown constant disturbance."""
