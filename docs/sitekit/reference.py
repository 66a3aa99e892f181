"""The reference of the Python package: a directive for the public names of some rooms, and the docstrings' reader."""

from __future__ import annotations

import ast
import inspect
import re
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

import barbalat

logger = logging.getLogger(__name__)

FIELD = re.compile(r"^(?P<names>[A-Za-z_][\w.]*(?:, [A-Za-z_][\w.]*)*) {2,}(?P<meaning>\S.*)$")
"""A line "name  meaning" of a docstring."""
CODE = re.compile(r"(``.+?``)", re.DOTALL)


def public_names() -> dict[str, list[str]]:
    """The names of ``__init__.pyi`` by the room they come from."""
    rooms: dict[str, list[str]] = {}
    stub = ast.parse(Path(barbalat.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    for node in stub.body:
        if isinstance(node, ast.ImportFrom) and node.module:
            rooms.setdefault(node.module.split(".")[0], []).extend(alias.asname or alias.name for alias in node.names)
    return rooms


class Rooms(SphinxDirective):
    """``{rooms} problem signals`` documents all public names of these rooms."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        rooms, lines = public_names(), []
        chosen = self.arguments[0].split()
        page = self.env.metadata[self.env.docname]
        page["rooms"] = " ".join([page.get("rooms", ""), *chosen])
        for room in chosen:
            for name in rooms[room]:
                lines += [*_directive(name), ""]
        return self.parse_text_to_nodes("\n".join(["```{eval-rst}", *lines, "```"]))  # the pages are Markdown


def _directive(name: str) -> list[str]:
    """How one public name is documented."""
    value = getattr(barbalat, name)
    if inspect.isclass(value):
        return [f".. autoclass:: barbalat.{name}", "   :members:"]
    return [f".. autofunction:: barbalat.{name}"] if callable(value) else [f".. autodata:: barbalat.{name}", "   :no-value:"]


def as_rst(*given: object) -> None:
    """Turn a docstring into reStructuredText: its lines "name  meaning" into a list of definitions, its prose into plain text."""
    lines = given[-1]
    assert isinstance(lines, list)  # Sphinx: application, kind, name, object, options, lines
    found: list[str] = []
    listed = False
    for line in lines:
        field = FIELD.match(line)
        if listed and line.startswith("  "):
            found.append(f"   {_plain(line.strip())}")
            continue
        formula = line.startswith("    ")
        if bool(field) != listed or (found and formula != found[-1].startswith("    ")):
            found.append("")  # a list, or a formula on a line of its own, begins or ends
        listed = bool(field)
        if field:
            names = ", ".join(f"``{name}``" for name in field["names"].split(", "))
            found += [names, f"   {_plain(field['meaning'])}"]
        else:
            found.append(_plain(line))
    lines[:] = found


def short_types(*given: object) -> tuple[str | None, str | None]:
    """A signature in which the arrays' types have their names, and not what Sphinx makes of these within a union."""
    arguments, returned = (re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", str(one)) if one else None for one in given[-2:])
    return arguments, returned


def _plain(text: str) -> str:
    """Characters that mean something to reStructuredText, and not here, are escaped outside of code."""
    parts = CODE.split(text)
    return "".join(part if i % 2 else re.sub(r"([*|`]|_(?!\w))", r"\\\1", part) for i, part in enumerate(parts))


def complete(_: Sphinx, env: BuildEnvironment) -> None:
    """Every room with public names stands on some page."""
    shown = {room for page in env.metadata.values() for room in page.get("rooms", "").split()}
    for room in sorted(set(public_names()) - shown):
        logger.warning("docs/reference: no page documents the public names of %s: add it to a {rooms} directive", room)


def plain_addresses(_: Sphinx, document: nodes.document) -> None:
    """An address such as tcp://HOST:PORT is one to write, not one to follow."""
    for link in list(document.findall(nodes.reference)):
        if link.get("refuri", "").startswith("tcp:"):
            link.replace_self(nodes.literal(link.astext(), link.astext()))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive and the docstrings' reader."""
    app.add_directive("rooms", Rooms)
    app.connect("autodoc-process-docstring", as_rst)
    app.connect("autodoc-process-signature", short_types)
    app.connect("env-check-consistency", complete)
    app.connect("doctree-read", plain_addresses)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
