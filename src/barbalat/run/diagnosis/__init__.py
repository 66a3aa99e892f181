"""What a finished run says of itself: numerical stability, excitation, whether it adapts."""
