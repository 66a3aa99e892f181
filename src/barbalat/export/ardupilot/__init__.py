"""The C of an export as a backend of ArduPilot's AC_CustomControl."""
