"""The transient of L1-AC against its filtered reference system, and of MRAC against its model, on Section V's plant."""
