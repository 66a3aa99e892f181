"""The colours of compared objects."""

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#B5609A", "#A87500", "#3391CE")
"""The palette of Okabe and Ito. The last three colours are darkened to a contrast ratio of 3 with white, which lines need."""
ON_DARK = ("#4BA6EA", "#FF8B3D", "#2FC79B", "#E39BCB", "#E6B23C", "#9AD1F5")
"""The same colours, lightened for a dark background."""
