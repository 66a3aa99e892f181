"""The search for settings: the aim, the trials, the plants on which they are judged, and the search method."""
