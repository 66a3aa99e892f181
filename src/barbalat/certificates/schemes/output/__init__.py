"""The certificates of the schemes that measure only y."""
