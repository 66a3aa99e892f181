"""What the schemes share: laws, their modifications, projection, normalisation. One file each; ``laws`` has the registry."""
