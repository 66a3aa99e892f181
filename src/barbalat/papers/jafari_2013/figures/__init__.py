"""The figures, and the statements of their captions and of the text about them."""
