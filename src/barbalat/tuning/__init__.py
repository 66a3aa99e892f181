"""Settings found by search: one controller's under constraints, and every scheme's under one rule."""
