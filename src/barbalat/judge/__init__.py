"""The one judge of every run: what its signals say of following, shaking, saturating and being lost."""
