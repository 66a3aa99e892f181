"""The trade-off between tracking and robustness, over all tunings of several schemes."""
