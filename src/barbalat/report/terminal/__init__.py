"""The commands' output on a terminal: one file for each screen, with a common layout."""
