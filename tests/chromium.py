"""The system's browser for the scripts that open pages: ``chromium``, or the one that BROWSER names."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, Page, sync_playwright


def look(findings: Callable[[Browser], Iterable[str]]) -> int:
    """Print each fault on a line and return the exit code."""
    with launched() as browser:
        found = list(dict.fromkeys(findings(browser)))
    print("\n".join(found) or "no findings")  # noqa: T201
    return int(bool(found))


@contextmanager
def launched() -> Iterator[Browser]:
    """The running browser. The process ends if there is none."""
    executable = os.environ.get("BROWSER") or shutil.which("chromium") or shutil.which("chromium-browser")
    if executable is None:
        sys.exit("no browser: install Debian's chromium, or name one by BROWSER")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=["--no-sandbox"])
        yield browser
        browser.close()


def overheard(tab: Page, own: tuple[str, ...]) -> list[str]:
    """The page's console messages and errors from now on, and its requests to addresses not in ``own``."""
    said: list[str] = []
    tab.on("console", lambda message: said.append(f"console: {message.text} {message.location['url']}"))
    tab.on("pageerror", lambda error: said.append(f"error: {error}"))
    tab.on("request", lambda request: None if request.url.startswith(own) else said.append(f"asks for {request.url}"))
    return said
