"""The output of the commands on a terminal: one file for each screen, with a common layout."""
