"""What a run says: its series and figures, and what a second look at them finds."""
