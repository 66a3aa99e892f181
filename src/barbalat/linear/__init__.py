"""LTI systems and all that is known of them without adaptive control."""
