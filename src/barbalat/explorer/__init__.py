"""The explorer: one HTML file that simulates a case by WebAssembly, with a slider for each number of the case."""
