"""Many runs of a case whose numbers vary, on a grid or at random: metrics, evaluation and storage."""
