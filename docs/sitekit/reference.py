"""The reference of the Python package: a directive for the names of a public module, and the docstrings' reader."""

from __future__ import annotations

import importlib
import inspect
import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.pycode import ModuleAnalyzer
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

from barbalat.public_names import PACKAGE, modules, places_of

logger = logging.getLogger(__name__)

FIELD = re.compile(r"^(?P<names>[A-Za-z_][\w.]*(?:, [A-Za-z_][\w.]*)*) {2,}(?P<meaning>\S.*)$")
"""A line "name  meaning" of a docstring."""
CODE = re.compile(r"(``.+?``)", re.DOTALL)


class PublicModule(SphinxDirective):
    """``{public-module} laws signals`` documents public modules with all their names; without an argument the package itself."""

    optional_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        chosen = [f"{PACKAGE}.{name}" for name in self.arguments[0].split()] if self.arguments else [PACKAGE]
        page, lines = self.env.metadata[self.env.docname], []
        page["modules"] = " ".join([page.get("modules", ""), *chosen])
        for place in chosen:
            module = importlib.import_module(place)
            lines += [f".. automodule:: {place}", "   :no-members:", ""]
            for name in module.__all__:
                if place != PACKAGE or name not in modules():
                    lines += [*_directive(place, name, getattr(module, name)), ""]
        return self.parse_text_to_nodes("\n".join(["```{eval-rst}", *lines, "```"]))  # the pages are Markdown


def _directive(module: str, name: str, value: object) -> list[str]:
    """How one public name is documented."""
    if inspect.isroutine(value):
        return [f".. autofunction:: {module}.{name}"]
    if inspect.isclass(value) and value is not Any:
        return [f".. autoclass:: {module}.{name}", "   :members:"]
    said = ModuleAnalyzer.for_module(places_of(module)[name]).find_attr_docs().get(("", name), [repr(value)])
    as_rst(said)
    return [f".. py:data:: {module}.{name}", "", *(f"   {line}" for line in said)]


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
    """Every public module stands on some page."""
    shown = {place for page in env.metadata.values() for place in page.get("modules", "").split()}
    for place in sorted({PACKAGE, *(f"{PACKAGE}.{name}" for name in modules())} - shown):
        logger.warning("docs/reference: no page documents %s: add it to a {public-module} directive", place)


def plain_addresses(_: Sphinx, document: nodes.document) -> None:
    """An address such as tcp://HOST:PORT is one to write, not one to follow."""
    for link in list(document.findall(nodes.reference)):
        if link.get("refuri", "").startswith("tcp:"):
            link.replace_self(nodes.literal(link.astext(), link.astext()))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive and the docstrings' reader."""
    app.add_directive("public-module", PublicModule)
    app.connect("autodoc-process-docstring", as_rst)
    app.connect("autodoc-process-signature", short_types)
    app.connect("env-check-consistency", complete)
    app.connect("doctree-read", plain_addresses)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
