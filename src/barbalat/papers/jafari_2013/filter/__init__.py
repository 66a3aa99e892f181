"""What the filter of L1 adaptive control does: its steady error, its condition, the margins, the control."""
