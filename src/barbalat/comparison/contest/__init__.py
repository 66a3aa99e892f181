"""Every scheme tuned under one rule, then measured on validation plants, commands and noise."""
