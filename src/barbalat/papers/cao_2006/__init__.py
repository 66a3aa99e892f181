"""The abstract of AIAA 2006-6347: phase and delay margins under high gain, beside a constant disturbance."""
