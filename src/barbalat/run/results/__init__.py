"""The results of a run: its series and metrics, and the findings of their examination."""
