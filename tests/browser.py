"""The program's pages in a real browser: nothing overflows, no request leaves the page, and everything is accessible.

    python tests/browser.py [PAGE.html | FOLDER ...] [--one-in N]

Without arguments it makes and checks the pages of the quick ``reproduce`` and of two bundled cases. A folder is treated as a
site: all of its pages are read through a server. Each page is opened at desktop width and, in dark mode, at phone width, and
checked for accessibility at both. For a page of a site, the commit selects one of the two widths, and with --one-in it also
selects the pages that are opened. Each fault is printed on a line, and the exit code is then 1.

The browser is the system's: see ``chromium``.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import threading
from collections.abc import Container, Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page

from chromium import look, overheard
from turns import drawn

WIDTHS = {"desk": 1280, "phone": 390}
"""The widths and heights of the windows in CSS pixels."""
LARGEST_PAGE, LARGEST_EXPLORER = 500_000, 1_000_000
"""Largest size in bytes of a page, and of a page that simulates."""
COMMANDS = {
    "reproduce": ["reproduce", "--quick"],
    "run": ["run", "first-order"],
    "output": ["run", "l1-output"],
}
"""The commands that make pages, by the folder to which they write."""
EXPLORER = "explore.html"
UNSCROLLABLE = """
() => [...document.querySelectorAll('body *')]
    .filter(one => one.getBoundingClientRect().right > innerWidth + 1 && !one.closest('.wide, svg, math'))
    .slice(0, 3).map(one => `${one.tagName.toLowerCase()} ${one.className} ${one.textContent.slice(0, 40)}`)
"""
"""Elements that exceed the window and are not within a scrollable element."""
SCROLLING = """
() => [...document.querySelectorAll('.wide:not(.diagram)')]
    .filter(one => one.scrollWidth > one.clientWidth + 1).slice(0, 3).map(one => one.textContent.trim().slice(0, 60))
"""
"""Tables whose columns are only visible after scrolling. Block diagrams may scroll."""
OWN_ADDRESSES = ("file:", "data:", "blob:", "http://127.0.0.1:")
"""The addresses that a page may request: those within it or in its folder."""
OPENED = "() => document.querySelectorAll('details').forEach(one => { one.open = true })"
"""Opens everything that is folded, so it is checked too."""


Tabs = dict[str, tuple[Page, list[str]]]
"""A tab of each width by its name, with its messages since its page was requested."""


def main(arguments: list[str]) -> int:
    """Check the pages and return the exit code."""
    parser = argparse.ArgumentParser(prog="browser.py")
    parser.add_argument("pages", nargs="*", type=Path)
    parser.add_argument("--one-in", type=int, default=1, help="of a folder's pages one in so many, which the commit draws")
    given = parser.parse_args(arguments)
    if given.one_in < 1:
        parser.error(f"--one-in takes 1, which keeps all, or more, but got {given.one_in}")
    with tempfile.TemporaryDirectory() as made:
        return look(lambda browser: _of_all(tabs(browser), given.pages or _made_in(Path(made)), given.one_in))


def tabs(browser: Browser) -> Tabs:
    """Two tabs for all pages. A new tab for each page would reload the site's styles, scripts and fonts."""
    found = {}
    for name, width in WIDTHS.items():
        tab = browser.new_page(viewport={"width": width, "height": 900}, color_scheme="dark" if name == "phone" else "light")
        found[name] = tab, overheard(tab, OWN_ADDRESSES)
    return found


def _of_all(opened: Tabs, pages: list[Path], one_in: int) -> Iterator[str]:
    """The faults of pages or of whole sites."""
    for page in pages:
        yield from _of_site(opened, page, one_in) if page.is_dir() else _findings(opened, page, page.resolve().as_uri())


def _made_in(folder: Path) -> list[Path]:
    """The pages of ``COMMANDS``."""
    for name, arguments in COMMANDS.items():
        command = [sys.executable, "-m", "barbalat", *arguments, "--out", str(folder / name)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    command = [sys.executable, "-m", "barbalat", "explore", "first-order", "--no-open", "--out", str(folder / EXPLORER)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return sorted(folder.rglob("*.html"))


def _of_site(opened: Tabs, folder: Path, one_in: int) -> Iterator[str]:
    """The faults of every n-th page of a site. The pages of ``barbalat reproduce`` are left out, because they are stored there
    unchanged.

    The pages share a style, so checking half of them at each width finds its faults in half the time.
    """
    places = [page.relative_to(folder) for page in sorted(folder.rglob("*.html"))]
    places = [place for place in places if place.parts[0] not in ("_static", "reproduction")]
    places = drawn(places, -(-len(places) // one_in), "pages")
    on_a_desk = drawn(places, len(places) // 2)
    with _served(folder) as address:
        for place in places:
            examined = {"desk" if place in on_a_desk else "phone"}
            yield from at_both_widths(opened, f"{folder.name}/{place}", f"{address}/{place.as_posix()}", examined)


@contextmanager
def _served(folder: Path) -> Iterator[str]:
    """The address at which this machine serves a folder to itself. axe reads style sheets again, which is not possible from
    files."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


class Quiet(SimpleHTTPRequestHandler):
    """Serves files without logging requests."""

    def log_message(self, *_: object) -> None:
        """Log nothing."""


def _findings(opened: Tabs, page: Path, address: str) -> Iterator[str]:
    """The faults of one of the program's pages."""
    most = LARGEST_EXPLORER if page.name == EXPLORER else LARGEST_PAGE
    if page.stat().st_size > most:
        yield f"{page.parent.name}/{page.name}: {page.stat().st_size} bytes, more than {most}"
    yield from at_both_widths(opened, f"{page.parent.name}/{page.name}", address)


def at_both_widths(opened: Tabs, page: str, address: str, examined: Container[str] = tuple(WIDTHS)) -> Iterator[str]:
    """The faults of a page at the widths in ``WIDTHS``. axe also examines the widths named in ``examined``."""
    for name, (tab, said) in opened.items():
        tab.goto("about:blank")  # otherwise an address that differs only in its fragment would not be reloaded
        said.clear()
        tab.goto(address)
        tab.evaluate(OPENED)
        found = [f"scrolls: {one}" for one in tab.evaluate(SCROLLING)]
        if tab.evaluate("document.scrollingElement.scrollWidth > innerWidth"):
            found += [f"sticks out: {one}" for one in tab.evaluate(UNSCROLLABLE)] or ["overflows"]
        for rule in Axe().run(tab).response["violations"] if name in examined else ():
            found += [f"{rule['id']}: {node['html'][:100]}" for node in rule["nodes"][:3]]
        yield from (f"{page} on a {name}: {one}" for one in (*said, *found) if "favicon" not in one)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
