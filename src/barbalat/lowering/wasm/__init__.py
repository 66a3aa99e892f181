"""Operation list -> WebAssembly: a module of the same time loop, for pages that simulate."""
