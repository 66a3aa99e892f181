"""Operation list -> WebAssembly: a module with the same time loop, for pages that simulate."""
