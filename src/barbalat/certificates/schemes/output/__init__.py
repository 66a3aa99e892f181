"""The certificates of the schemes that measure y only."""
