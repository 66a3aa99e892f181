"""The search for settings: the aim, the trials, the plants on which these are judged, and the search method."""
