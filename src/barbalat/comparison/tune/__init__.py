"""Settings of a controller, found by search under constraints."""
