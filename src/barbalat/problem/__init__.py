"""Tracking problems: plant, known set, actuation and measurement."""
