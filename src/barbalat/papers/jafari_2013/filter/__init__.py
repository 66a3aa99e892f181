"""The effects of the filter of L1 adaptive control: steady error, stability condition, margins, control."""
