"""Many runs of a case whose numbers vary, on a grid or drawn: their figures, what they are evidence of, and how they are kept."""
