"""The bundled cases."""
