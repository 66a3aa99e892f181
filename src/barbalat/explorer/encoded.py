"""Arrays as text in a page."""

from __future__ import annotations

import base64

import numpy as np

from barbalat.validate import Array


def doubles(values: Array) -> str:
    """Encode numbers for a page, as Base64 of little-endian doubles."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode()
