"""The finished pages are corrected for screen readers, and read once more.

Links inside the site must lead somewhere, nothing may be fetched from outside, no picture may be missing. A build has no network,
so of a link to outside only its form is looked at.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from sphinx.application import Sphinx
from sphinx.util import logging

logger = logging.getLogger(__name__)

LOADING = {"img": "src", "script": "src", "link": "href", "iframe": "src", "source": "src"}
"""Elements that a browser loads something for by itself, and the attribute that says what."""


@dataclass
class Page(HTMLParser):
    """What one page links to, and the anchors that it has."""

    anchors: set[str] = field(default_factory=set)
    links: list[str] = field(default_factory=list)
    loads: list[str] = field(default_factory=list)
    pictures: int = 0
    unnamed: int = 0  # pictures that say nothing of a text in their place
    explorer: str | None = None  # what an explorer is made from, as far as it has been read

    def __post_init__(self) -> None:
        super().__init__()

    def handle_data(self, data: str) -> None:
        if self.explorer is not None:
            self.explorer += data

    def handle_endtag(self, tag: str) -> None:
        """A lesson of an explorer has an address, which its page reads by itself."""
        if tag == "script" and self.explorer is not None:
            self.anchors.update(f"lesson={lesson['key']}" for lesson in json.loads(self.explorer)["lessons"])
            self.explorer = None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {key: value or "" for key, value in attrs}
        if "id" in given:
            self.anchors.add(given["id"])
        if tag == "script" and given.get("id") == "data":
            self.explorer = ""
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        if tag in LOADING and given.get(LOADING[tag]) and given.get("rel") != "canonical":
            self.loads.append(given[LOADING[tag]])
        self.pictures += tag == "img"
        self.unnamed += tag == "img" and "alt" not in given  # an empty text is one: of a picture beside its title


FOR_READERS_ALOUD = (
    (r'role="heading">', 'role="heading" aria-level="2">'),  # captions of the contents
    (r"<pre>", '<pre tabindex="0">'),  # scrolls on a phone, so the keyboard must reach it
    (r'<div class="(table-wrapper[^"]*|math)"', r'<div class="\1" tabindex="0"'),  # likewise
    (r'<th class="head">(?:<p>)?(?:</p>)?</th>|<th></th>', "<td></td>"),  # the corner of a table
    (r'<aside class="sidebar-drawer"', '<aside class="sidebar-drawer" aria-label="Site"'),
    (r'<aside class="toc-drawer', '<aside aria-label="On this page" class="toc-drawer'),
    (
        r'(<a class="reference internal" href="plot_[^"]*")(><span class="doc">([^<]*)</span>)',
        r'\1 aria-label="\3"\2',
    ),  # thumbnails
    (r'<dl>(?=\s*<dd><em class="sig-param)', '<dl role="none">'),  # a signature on several lines defines nothing
    (r'(<article role="main"[^>]*>)(?=\s*<noscript>)', r"\1<h1>Search</h1>"),  # the theme's page of results has no title
)
"""What Sphinx, its theme, its gallery and pandas write, and what screen readers and keyboards need in its place."""


def keep_reproduction(app: Sphinx, exception: Exception | None) -> None:
    """Put the pages of ``barbalat reproduce``, which the ledger's page has made, beside the site's."""
    if exception is None and app.builder.format == "html":
        shutil.copytree(os.environ["BARBALAT_REPRODUCTION"], Path(app.outdir) / "reproduction", dirs_exist_ok=True)


def mend(app: Sphinx, exception: Exception | None) -> None:
    """Add to the finished pages what accessibility requires."""
    if exception is not None or app.builder.format != "html":
        return
    for path in Path(app.outdir).rglob("*.html"):
        if "reproduction" in path.parts:  # the program's own pages, looked at by ./dev browser
            continue
        text = path.read_text(encoding="utf-8")
        for written, meant in FOR_READERS_ALOUD:
            text = re.sub(written, meant, text)
        path.write_text(text, encoding="utf-8")


def check(app: Sphinx, exception: Exception | None) -> None:
    """Warn of each link that leads nowhere; warnings are errors."""
    if exception is not None or app.builder.format != "html":
        return
    root = Path(app.outdir)
    pages = {path: _read(path) for path in sorted(root.rglob("*.html")) if "_static" not in path.parts}
    for name in app.env.found_docs:
        promised = Path(app.env.doc2path(name)).read_text(encoding="utf-8").count("\n  image:\n    alt:")
        if pages[root / f"{name}.html"].pictures < promised:
            logger.warning("a cell that should make a picture does not", location=name)
    for path, page in pages.items():
        for found in [*(_fault(path, link, root, pages) for link in page.links + page.loads), *_of_loads(page)]:
            if found:
                logger.warning("%s: %s", path.relative_to(root), found)


def _of_loads(page: Page) -> list[str]:
    outside = [f"{one} is fetched from outside" for one in page.loads if urlsplit(one).netloc]
    return outside + [f"{page.unnamed} pictures without alternative text"] * bool(page.unnamed)


def _fault(path: Path, link: str, root: Path, pages: dict[Path, Page]) -> str | None:
    """What is wrong with a link; ``None`` where nothing is."""
    parts = urlsplit(link)
    if parts.scheme in ("data", "mailto"):
        return None
    if parts.scheme or parts.netloc:
        sound = parts.scheme == "https" and "." in parts.netloc and not set(link) & set(" <>\"'`{}")
        return None if sound else f"{link} is no sound link to outside: https://host/... is meant"
    target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
    if target.is_dir():
        target /= "index.html"
    if not target.exists() or not target.is_relative_to(root.resolve()):
        return f"{link} leads nowhere"
    page = pages.get(target)
    missing = parts.fragment and page is not None and unquote(parts.fragment) not in page.anchors
    return f"{link} leads to an anchor that is not there" if missing else None


def _read(path: Path) -> Page:
    page = Page()
    page.feed(path.read_text(encoding="utf-8"))
    return page


def setup(app: Sphinx) -> dict[str, bool]:
    """Look at the pages when all are written."""
    app.connect("build-finished", keep_reproduction)
    app.connect("build-finished", mend)
    app.connect("build-finished", check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
