"""Translates an operation list to a WebAssembly module with the same time loop, for pages that simulate."""
