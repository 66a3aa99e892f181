"""The bundled cases, and how a TOML case file becomes validated objects."""
