"""Every scheme tuned under one rule, then measured on plants, commands and noise that no tuning saw."""
