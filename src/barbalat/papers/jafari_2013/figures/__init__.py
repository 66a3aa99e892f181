"""The figures, and the statements about them in their captions and in the text."""
