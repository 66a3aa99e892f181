"""The exact margins of the loops that MRAC and L1-AC are beside an unknown constant disturbance."""
