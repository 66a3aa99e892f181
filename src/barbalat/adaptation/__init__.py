"""What the schemes share: projection, adaptive laws, normalisation."""
