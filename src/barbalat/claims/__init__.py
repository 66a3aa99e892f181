"""What the paper shows and says, measured."""
