"""Many runs of a case whose numbers vary, on a grid or at random: their figures, their evaluation, and their storage."""
