"""The results of a run: its series and metrics, and findings about them."""
