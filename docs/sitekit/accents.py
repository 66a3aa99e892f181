"""MathML in which the subscript of an accented letter stands beside it; docutils sets it below, like the limit of a sum."""

from __future__ import annotations

import re
from html import unescape
from xml.etree import ElementTree

MATHML = "http://www.w3.org/1998/Math/MathML"


def with_subscripts_beside(mathml: str) -> str:
    """For each ``munderover`` of a letter, its subscript and an accent: ``msub`` of the accented letter and its subscript."""
    ElementTree.register_namespace("", MATHML)
    root = ElementTree.fromstring(re.sub(r"&(?!lt;|gt;|amp;|quot;|#)\w+;", lambda found: unescape(found[0]), mathml))
    for found in list(root.iter(_tag("munderover"))):
        base, index, accent = list(found)
        if base.tag != _tag("mo") and accent.tag == _tag("mo"):  # sums, limits and their like are operators
            over = ElementTree.Element(_tag("mover"), {"accent": "true"})
            over.extend([base, accent])
            found.tag = _tag("msub")
            found[:] = [over, index]
    return ElementTree.tostring(root, encoding="unicode")


def _tag(name: str) -> str:
    return f"{{{MATHML}}}{name}"
