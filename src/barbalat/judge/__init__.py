"""The judge of every run: from its signals it decides whether the run follows, oscillates, saturates or is lost."""
