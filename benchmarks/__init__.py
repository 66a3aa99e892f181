"""Side by side with its peers, in one run: ``python -m benchmarks`` from the repository root."""
