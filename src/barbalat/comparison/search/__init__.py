"""The search for settings: what is asked of them, which are tried, on which plants they are judged, which is best."""
