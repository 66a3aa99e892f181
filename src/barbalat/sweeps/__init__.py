"""Many runs of a case whose numbers vary, on a grid or at random: their metrics, their evaluation, and their storage."""
