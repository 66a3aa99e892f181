"""A Lyapunov function supplied by the author of a law: read exactly, V' <= -W proven or rejected, and the consequences."""
