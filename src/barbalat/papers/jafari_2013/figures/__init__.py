"""What the figures show, and what their captions and the text say of them."""
