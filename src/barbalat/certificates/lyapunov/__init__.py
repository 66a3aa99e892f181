"""A Lyapunov function supplied by the author of a law: read exactly, V' <= -W proven or refused, and the consequences."""
