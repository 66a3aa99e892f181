"""Source in C99 for any flight computer, with a self-test."""
