"""Lyapunov functions supplied by the author of a law: they are read exactly, V' <= -W is proven or rejected, and the consequences
are derived."""
