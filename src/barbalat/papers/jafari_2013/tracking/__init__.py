"""How well the schemes track: Theorem 1's bounds, any command, L1's own objective, every respect at once."""
