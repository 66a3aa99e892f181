"""The program's pages in a real browser: nothing overflows, nothing is asked for outside, nothing is inaccessible.

    python tests/browser.py [PAGE.html ...]

Without pages it makes those of the quick ``reproduce`` and of two bundled cases. Each is opened at the width of a desk and of
a phone. What is wrong is printed, a line each, and the exit code is 1. The browser is the system's: ``chromium``, or what
BROWSER names.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, sync_playwright

WIDTHS = {"desk": 1280, "phone": 390}
"""In CSS pixels."""
LARGEST_PAGE = 500_000
"""Bytes of a page; explorers are pages of another kind."""
COMMANDS = {
    "reproduce": ["reproduce", "--quick"],
    "run": ["run", "first-order"],
    "output": ["run", "l1-output"],
}
"""What makes pages, by the folder that they go to."""
UNSCROLLABLE = """
() => [...document.querySelectorAll('body *')]
    .filter(one => one.getBoundingClientRect().right > innerWidth + 1 && !one.closest('.wide, svg, math'))
    .slice(0, 3).map(one => `${one.tagName.toLowerCase()} ${one.className} ${one.textContent.slice(0, 40)}`)
"""
"""What sticks out of the window and lies in nothing that scrolls."""
SCROLLING = """
() => [...document.querySelectorAll('.wide')]
    .filter(one => one.scrollWidth > one.clientWidth + 1).slice(0, 3).map(one => one.textContent.trim().slice(0, 60))
"""
"""Tables of which one must scroll to see all columns."""
OPENED = "() => document.querySelectorAll('details').forEach(one => { one.open = true })"
"""What is folded away is looked at too."""


def main(pages: list[Path]) -> int:
    """Returns the exit code."""
    executable = os.environ.get("BROWSER") or shutil.which("chromium") or shutil.which("chromium-browser")
    if executable is None:
        print("no browser: install Debian's chromium, or name one by BROWSER", file=sys.stderr)  # noqa: T201
        return 1
    with tempfile.TemporaryDirectory() as made, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=["--no-sandbox"])
        found = [finding for page in pages or _made_in(Path(made)) for finding in _findings(browser, page)]
        browser.close()
    print("\n".join(dict.fromkeys(found)) or "no findings")  # noqa: T201
    return int(bool(found))


def _made_in(folder: Path) -> list[Path]:
    """The pages of ``COMMANDS``."""
    for name, arguments in COMMANDS.items():
        command = [sys.executable, "-m", "barbalat", *arguments, "--out", str(folder / name)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return sorted(folder.rglob("*.html"))


def _findings(browser: Browser, page: Path) -> Iterator[str]:
    """What is wrong with a page, at both widths."""
    if page.stat().st_size > LARGEST_PAGE:
        yield f"{page.parent.name}/{page.name}: {page.stat().st_size} bytes, more than {LARGEST_PAGE}"
    for name, width in WIDTHS.items():
        tab = browser.new_page(viewport={"width": width, "height": 900})
        said: list[str] = []
        tab.on("console", lambda message, said=said: said.append(f"console: {message.text}"))
        tab.on("pageerror", lambda error, said=said: said.append(f"error: {error}"))
        tab.on("request", lambda request, said=said: said.append(f"asks for {request.url}") if _is_outside(request.url) else None)
        tab.goto(page.resolve().as_uri())
        tab.evaluate(OPENED)
        said += [f"scrolls: {one}" for one in tab.evaluate(SCROLLING)]
        if tab.evaluate("document.scrollingElement.scrollWidth > innerWidth"):
            said += [f"sticks out: {one}" for one in tab.evaluate(UNSCROLLABLE)] or ["overflows"]
        for rule in Axe().run(tab).response["violations"]:
            said += [f"{rule['id']}: {node['html'][:100]}" for node in rule["nodes"][:3]]
        yield from (f"{page.parent.name}/{page.name} on a {name}: {one}" for one in said)
        tab.close()


def _is_outside(address: str) -> bool:
    return not address.startswith(("file:", "data:", "blob:"))


if __name__ == "__main__":
    sys.exit(main([Path(page) for page in sys.argv[1:]]))
