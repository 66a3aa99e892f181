"""JSBSim's F-16, which follows a pitch-rate or a roll-rate command."""
