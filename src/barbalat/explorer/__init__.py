"""The explorer: one HTML file that simulates a case by WebAssembly, with a slider for each of its numbers."""
