"""The judge of every run. It decides from the signals whether the run follows, oscillates, saturates or is lost."""
