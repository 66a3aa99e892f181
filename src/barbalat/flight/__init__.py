"""Controllers on flight models that others made: JSBSim's F-16, in a process of its own."""
