"""The bundled cases and the case file: TOML in, validated objects out."""
