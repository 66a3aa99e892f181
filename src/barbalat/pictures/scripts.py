"""The parts of pages with charts: uPlot with its licence, scripts, and data as JSON in a script element."""

from __future__ import annotations

import json
import re
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any

_TEMPLATES = resources.files("barbalat.pictures") / "templates"
UPLOT, UPLOT_STYLE, UPLOT_LICENCE = (_TEMPLATES / "uplot" / name for name in ("uPlot.iife.min.js", "uPlot.min.css", "LICENSE"))
CHARTS = (_TEMPLATES / "zoom.js", _TEMPLATES / "charts.js")
"""The charts' own scripts, in the order of their dependencies."""


def as_script_data(part: Any) -> str:
    """Return JSON in which no text can end the surrounding script element, where only JSON's escapes work."""
    return json.dumps(part, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")


def script_of(module: Traversable) -> str:
    """Return a module's text without its imports and exports. One file contains all modules, and none can be imported from
    it."""
    text = re.sub(r"^import .*;$", "", module.read_text("utf-8"), flags=re.MULTILINE)
    return re.sub(r"^export ", "", text, flags=re.MULTILINE)
