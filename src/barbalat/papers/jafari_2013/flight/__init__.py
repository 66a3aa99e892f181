"""Stored flights of drawn vehicles: adaptive schemes beside linear designs."""
