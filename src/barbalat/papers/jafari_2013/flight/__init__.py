"""Stored flights of random vehicles: adaptive schemes compared with linear designs."""
