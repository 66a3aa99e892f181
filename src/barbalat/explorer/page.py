"""The page as one file: data, modules, scripts and styles inside; nothing is asked for elsewhere."""

from __future__ import annotations

import json
import re
from html import escape
from importlib import resources
from typing import Any

import barbalat
from barbalat.validate import InputError

LARGEST_PAGE = 1_000_000
"""Bytes: what a mail takes and a phone opens at once."""
WORKER_FILES = (
    "bytes.js",
    "grid.js",
    "kernel.js",
    "noise.js",
    "figures.js",
    "spectrum.js",
    "stability.js",
    "impulse.js",
    "worker.js",
)
PAGE_FILES = (
    "bytes.js", "setting.js", "lessons.js", "address.js", "copies.js", "panels.js", "zoom.js", "charts.js", "table.js",
    "controls.js", "page.js",
)  # fmt: skip
"""Scripts in the order in which one needs the other."""


def html(data: dict[str, Any], certificates: str) -> str:
    """The whole page; InputError where it would be too large to be sent."""
    parts = {
        "TITLE": escape(str(data["case"])),
        "VERSION": escape(barbalat.__version__),
        "STYLE": _text("uplot/uPlot.min.css") + _text("page.css"),
        "UPLOT": _text("uplot/uPlot.iife.min.js"),
        "LICENCE": escape(_text("uplot/LICENSE").strip()),
        "DATA": as_script_data(data),
        "WORKER": as_script_data("\n".join(map(_script, WORKER_FILES))),
        "PAGE": "\n".join(map(_script, PAGE_FILES)),
        "CERTIFICATES": certificates,
    }
    page = re.sub(r"\{\{([A-Z]+)\}\}", lambda found: parts[found[1]], _text("explore.html"))
    if (size := len(page.encode())) > LARGEST_PAGE:
        raise InputError(f"the page would have {size} bytes, more than {LARGEST_PAGE}: explore fewer controllers at a time")
    return page


def as_script_data(part: Any) -> str:
    """JSON that no text in it can end: a script element knows no escapes but those of JSON."""
    return json.dumps(part, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")


def _text(name: str) -> str:
    return (resources.files("barbalat.explorer") / "templates" / name).read_text("utf-8")


def _script(name: str) -> str:
    """A module's text without its imports and exports: one file holds them all, from which modules can't be imported."""
    text = re.sub(r"^import .*;$", "", _text(name), flags=re.MULTILINE)
    return re.sub(r"^export ", "", text, flags=re.MULTILINE)
