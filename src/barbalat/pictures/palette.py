"""The colours of compared objects."""

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#B5609A", "#A87500", "#3391CE")
"""Okabe and Ito's palette, with the last three darkened to three times the contrast with white that a line needs."""
ON_DARK = ("#4BA6EA", "#FF8B3D", "#2FC79B", "#E39BCB", "#E6B23C", "#9AD1F5")
"""The same colours, light enough for a dark background."""
