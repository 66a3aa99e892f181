"""What the commands show on a terminal: one file for each screen, on the layout they share."""
