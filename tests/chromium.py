"""The system's browser, for what opens pages in it: ``chromium``, or what BROWSER names."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterable

from playwright.sync_api import Browser, Page, sync_playwright


def look(findings: Callable[[Browser], Iterable[str]]) -> int:
    """Print what is found wrong, a line each; returns the exit code."""
    executable = os.environ.get("BROWSER") or shutil.which("chromium") or shutil.which("chromium-browser")
    if executable is None:
        print("no browser: install Debian's chromium, or name one by BROWSER", file=sys.stderr)  # noqa: T201
        return 1
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=["--no-sandbox"])
        found = list(dict.fromkeys(findings(browser)))
        browser.close()
    print("\n".join(found) or "no findings")  # noqa: T201
    return int(bool(found))


def overheard(tab: Page, own: tuple[str, ...]) -> list[str]:
    """What the page says from now on: to the console, as errors, and to addresses that begin with none of its ``own``."""
    said: list[str] = []
    tab.on("console", lambda message: said.append(f"console: {message.text} {message.location['url']}"))
    tab.on("pageerror", lambda error: said.append(f"error: {error}"))
    tab.on("request", lambda request: None if request.url.startswith(own) else said.append(f"asks for {request.url}"))
    return said
