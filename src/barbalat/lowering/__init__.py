"""From expressions to machine code; this package knows no control theory."""
