"""From expressions to machine code; this package contains no control theory."""
