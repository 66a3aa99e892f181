"""The abstract of AIAA 2006-6347: phase and delay margins under high gain, with a constant disturbance."""
