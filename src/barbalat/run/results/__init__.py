"""The results of a run: its series and figures, and the findings of their examination."""
