"""What the schemes share: laws, their modifications, normalisation; ``laws`` has the registry."""
