"""JSBSim's F-16, which tracks a pitch-rate or a roll-rate command."""
