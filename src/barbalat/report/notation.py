"""Converts the notation of terminals, such as theta_hat'Gamma^-1, to mathematics on a page: letters with accents, subscripts and
superscripts.

Names of values in Python and in the JSON, such as error_bound or step_max, are not converted but set as code.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection

from markupsafe import Markup, escape

ACCENTS = {
    "hat": "COMBINING CIRCUMFLEX ACCENT",
    "tilde": "COMBINING TILDE",
    "bar": "COMBINING MACRON",
    "dot": "COMBINING DOT ABOVE",
}
"""Parts of a name that are set above its letter, by their Unicode names."""
LETTERS = (
    "alpha beta gamma delta epsilon zeta eta theta kappa lambda mu nu xi rho sigma tau phi psi omega "
    "Gamma Delta Theta Lambda Xi Sigma Phi Psi Omega"
)
"""Greek letters by their names; the number pi never occurs as a word."""
SIGNS = {"<=": "≤", ">=": "≥", "+-": "±", "->": "→", "inf": "∞", " - ": " − "}
UNITS = "s|ms|rad/s|rad|Hz|dB|%"
"""Units that stay on the line of their number."""

_GREEK = {
    name: unicodedata.lookup(
        f"GREEK {'SMALL' if name.islower() else 'CAPITAL'} LETTER {'LAMDA' if name.lower() == 'lambda' else name.upper()}"
    )
    for name in LETTERS.split()
}
_TOKEN = re.compile(
    r"(?P<power>\^(?:-?\w+(?:\.\d+)?|\([^()]*\)))"
    r"|(?P<norm>\|\|(?:_\w+)?|\|_\d)"
    r"|(?P<root>\bsqrt\()"
    rf"|(?P<number>(?<![\w.^)-])(?P<digits>-?\d+(?:\.\d+)?)(?:e(?P<ten>[-+]?\d+))?(?![\w.]*\w)(?P<unit> (?:{UNITS})(?!\w))?)"
    rf"|(?P<name>(?:(?<![\w.])|(?<=\bs))(?:{'|'.join(sorted(_GREEK, key=len, reverse=True))}|[A-Za-z](?=_))"
    r"(?:_[A-Za-z0-9]+)*\d*(?![\w])(?P<prime>'(?!s\b))?)"
    r"|(?P<signal>(?<=\|)[a-zA-Z](?=\|)|\bh(?= \|)|\b[a-zA-Z](?= (?:=|<|<=|>|>=) |\())"
    r"|(?P<code>\b[a-z]{2,}(?:_[a-z0-9]+)+\b)"
    r"|(?P<sign><=|>=|\+-|->|\binf\b|(?<=\S) - (?=\S))"
)


def mathematics(text: str) -> Markup:
    """Return the text for a page: names, numbers, powers, roots and signs as mathematics, everything else escaped."""
    parts: list[Markup] = []
    end = 0
    for token in _TOKEN.finditer(text):
        parts += [escape(text[end : token.start()]), _typeset(token)]
        end = token.end()
    return Markup().join([*parts, escape(text[end:])])


def naming(text: str, names: Collection[str]) -> Markup:
    """Return the text for a page, with these names, such as tau-error, set as code."""
    if not names:
        return mathematics(text)
    known = "|".join(map(re.escape, sorted(names, key=len, reverse=True)))
    parts = re.split(rf"(?<![\w-])({known})(?![\w-])", text)
    return Markup().join(Markup("<code>{}</code>").format(part) if i % 2 else mathematics(part) for i, part in enumerate(parts))


def _typeset(token: re.Match[str]) -> Markup:
    match token.lastgroup:
        case "power":
            exponent = token[0][1:].removeprefix("(").removesuffix(")").replace("-", "−")
            return Markup("<sup>{}</sup>").format(exponent)
        case "norm":
            bars = "‖" if token[0].startswith("||") else "|"
            below = token[0].lstrip("|").removeprefix("_")
            return Markup("{}<sub>{}</sub>").format(bars, SIGNS.get(below, below)) if below else Markup(bars)
        case "root":
            return Markup("√(")
        case "number":
            return _number(token)
        case "signal":
            return Markup("<var>{}</var>").format(token[0])
        case "code":
            return _code(token[0])
        case "sign":
            return Markup(SIGNS[token[0]])
    name = token[0]
    return _name(name.removesuffix("'")) + ("′" if name.endswith("'") else "")


def _number(token: re.Match[str]) -> Markup:
    """Set a number such as 1e-4 s with a power of ten, and keep its unit on the same line."""
    digits, ten = token["digits"].replace("-", "−"), token["ten"]
    unit = (token["unit"] or "").replace(" ", "\u00a0")
    if ten is None:
        return escape(digits + unit)
    mantissa = {"1": "", "−1": "−"}.get(digits, f"{digits}·")
    return Markup("{}10<sup>{}</sup>{}").format(mantissa, str(int(ten)).replace("-", "−"), unit)


def _name(name: str) -> Markup:
    """Set a letter with its accents and subscripts. A name with more than two of these is not a symbol."""
    base, *parts = re.sub(rf"({'|'.join(ACCENTS)})(\d+)$", r"\1_\2", name).split("_")
    accents = [unicodedata.lookup(ACCENTS[part]) for part in parts if part in ACCENTS]
    below = [_GREEK.get(part, part) for part in parts if part not in ACCENTS]
    if len(below) > 2:
        return _code(name)
    letter = Markup("<var>{}</var>").format("".join((_GREEK.get(base, base), *accents)))
    return letter + (Markup("<sub>{}</sub>").format(", ".join(below)) if below else Markup())


def _code(name: str) -> Markup:
    """Set a Python name as code, which may break after an underscore."""
    return Markup("<code>{}</code>").format(Markup("_<wbr>").join(name.split("_")))
